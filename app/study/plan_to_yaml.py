"""A stored plan as a `study.yaml` again: without comments, and without the defaults."""

import yaml

from .plan import Plan

#: What tells how people are paid.
_OF_PAYMENT = ("codes", "return_urls")


def plan_text(plan: Plan, *, with_codes: bool = True) -> str:
    """The text of a `study.yaml` that says this plan, or all of it but codes and ways back."""
    said = plan.model_dump(mode="json", exclude_defaults=True)
    if not with_codes and "recruitment" in said:
        said["recruitment"] = {
            name: value for name, value in said["recruitment"].items() if name not in _OF_PAYMENT
        }
    text: str = yaml.safe_dump(said, sort_keys=False, allow_unicode=True, width=100)
    return text
