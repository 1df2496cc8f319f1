# vt-pipeline on a CPU: docker build -t vt-pipeline . && docker run --rm -v "$PWD/data:/data" vt-pipeline run sample-surfaces --data toy
# For GPUs leave the line with download.pytorch.org out: torch from PyPI includes CUDA.
FROM python:3.13-slim-bookworm
RUN apt-get update && apt-get install -y --no-install-recommends libegl1 libgl1 libxrender1 libgl1-mesa-dri && rm -rf /var/lib/apt/lists/*
COPY . /vt-pipeline
RUN pip install --no-cache-dir "$(grep '^torch==' /vt-pipeline/constraints.txt)" --index-url https://download.pytorch.org/whl/cpu
RUN pip install --no-cache-dir -c /vt-pipeline/constraints.txt /vt-pipeline
WORKDIR /data
ENTRYPOINT ["vt-pipeline"]
