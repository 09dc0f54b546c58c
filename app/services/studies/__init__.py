"""Studies: creation, versions of the plan, life cycle, access and sharing."""
