"""Many explorations in one process, stepped together by kernels."""
