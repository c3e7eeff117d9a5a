"""``slamgym gan <command>``: train, translate, evaluate, publish."""

__all__: list[str] = []
