"""``slamgym gan <command>``: train, translate, evaluate."""

__all__: list[str] = []
