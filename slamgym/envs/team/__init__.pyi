from .parallel import parallel_env

__all__ = ["parallel_env"]
