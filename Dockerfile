FROM debian:bookworm-slim
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates curl make python3.11 python3.11-venv \
    libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri && rm -rf /var/lib/apt/lists/*
RUN useradd --uid 10001 --create-home snakeslam \
    && install -d -o snakeslam -g snakeslam -m 0700 /run/snakeslam /var/lib/snakeslam \
    && install -d -o snakeslam -g snakeslam /snakeslam /snakeslam/runs
WORKDIR /snakeslam
# Nothing runs as root; the volumes below take the owner of these folders when they are made.
USER snakeslam
COPY --chown=snakeslam:snakeslam . .
RUN make setup
ENV PATH=/snakeslam/.venv/bin:$PATH OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
