FROM debian:bookworm-slim
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates curl make python3.11 python3.11-venv \
    libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri && rm -rf /var/lib/apt/lists/*
WORKDIR /snakeslam
COPY . .
RUN make setup && mkdir -m 0700 /run/snakeslam
ENV PATH=/snakeslam/.venv/bin:$PATH OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
