"""A stored plan as a `study.yaml` again: without comments, and without the defaults."""

import yaml

from app.study.plan import Plan


def plan_text(plan: Plan) -> str:
    """The text of a `study.yaml` that says this plan."""
    said = plan.model_dump(mode="json", exclude_defaults=True)
    text: str = yaml.safe_dump(said, sort_keys=False, allow_unicode=True, width=100)
    return text
