# antway with its kernels compiled: docker build -t antway . && docker run --rm antway run office
# Not built by the tests of this repository, which run where no container engine is.
FROM python:3.12-slim
COPY . /src
RUN pip install --no-cache-dir "/src[web]" && rm -rf /src
RUN useradd --create-home robot
USER robot
WORKDIR /home/robot
ENV NUMBA_CACHE_DIR=/home/robot/.cache/antway
RUN antway plan --help > /dev/null
ENTRYPOINT ["antway"]
CMD ["--help"]
