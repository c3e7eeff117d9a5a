"""Many explorations in one process, stepped together by kernels."""

__all__: list[str] = []
