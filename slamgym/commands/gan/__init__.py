"""``slamgym gan <command>``: train, translate, evaluate, publish."""
