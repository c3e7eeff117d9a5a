# slamgym with its ROS 2 nodes:  docker build -t slamgym . && docker run --rm -v "$PWD:/work" slamgym generate --pairs 8 --out pairs
FROM python:3.11-slim
ENV OMP_NUM_THREADS=1 PIP_NO_CACHE_DIR=1 NUMBA_CACHE_DIR=/opt/kernels
WORKDIR /src
COPY . .
# The extras to install; gan and agents bring torch, 1 GB and more.
ARG EXTRAS=ros,ros2
# What constraints.txt names is what the tests ran with. numba takes kernels only from a folder that it may write in:
# other users than root (docker run --user) would compile them again.
RUN pip install --constraint constraints.txt ".[${EXTRAS}]" && slamgym warmup && chmod -R a+rwX /opt/kernels
WORKDIR /work
ENTRYPOINT ["slamgym"]
CMD ["--help"]
