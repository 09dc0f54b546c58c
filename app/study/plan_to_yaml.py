"""Writes a stored plan as `study.yaml`, without comments and defaults."""

import yaml

from .plan import Plan

#: Fields with completion codes and return links.
_OF_PAYMENT = ("codes", "return_urls")


def plan_text(plan: Plan, *, with_codes: bool = True) -> str:
    """The text of a `study.yaml` with this plan, optionally without codes and return links."""
    said = plan.model_dump(mode="json", exclude_defaults=True)
    if not with_codes and "recruitment" in said:
        said["recruitment"] = {
            name: value for name, value in said["recruitment"].items() if name not in _OF_PAYMENT
        }
    text: str = yaml.safe_dump(said, sort_keys=False, allow_unicode=True, width=100)
    return text
