# docker build -t iout .
# docker run --rm -v "$PWD/runs:/data/runs" --user "$(id -u):$(id -g)" iout train paper/k3-fdd
FROM python:3.11-slim AS build

ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1
WORKDIR /source
RUN python -m venv /opt/iout
# torch first, from the index of its CPU builds: the other index has GPU packages of several GB.
COPY constraints.txt ./
RUN /opt/iout/bin/pip install --constraint constraints.txt hatchling \
    && /opt/iout/bin/pip install --index-url https://download.pytorch.org/whl/cpu torch==2.13.0
COPY . .
RUN /opt/iout/bin/pip install --constraint constraints.txt --no-build-isolation '.[report]'

FROM python:3.11-slim
COPY --from=build /opt/iout /opt/iout
ENV HOME=/data MPLCONFIGDIR=/tmp/matplotlib OMP_NUM_THREADS=1 PATH=/opt/iout/bin:$PATH PYTHONUNBUFFERED=1
# Nobody in particular: whoever runs it writes results as themselves, by `--user`.
RUN useradd --uid 10001 --home-dir /data --no-create-home iout \
    && install --directory --owner iout --mode 0777 /data /data/runs
USER 10001
WORKDIR /data
ENTRYPOINT ["iout"]
CMD ["--help"]
