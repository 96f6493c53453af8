# fapengine with everything that it draws, says and hears with, on a software renderer: for CI, and for a server.
#   docker build -t fapengine . && docker run --rm -v "$PWD:/work" fapengine say "Hello there." -o hello.mp4
#   docker run --rm -p 8110:8110 -p 9110:9110/udp fapengine serve --host 0.0.0.0
FROM python:3.12-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends git && rm -rf /var/lib/apt/lists/*
COPY . /source
RUN pip wheel --no-cache-dir --wheel-dir /wheels "/source[voice,video,recognizer,fast,live,batch,nats]"

FROM python:3.12-slim-bookworm
RUN apt-get update && apt-get install -y --no-install-recommends libegl1 libgl1 libgl1-mesa-dri libportaudio2 \
    && rm -rf /var/lib/apt/lists/*
RUN --mount=type=bind,from=build,source=/wheels,target=/wheels pip install --no-cache-dir --no-index /wheels/*.whl
RUN useradd --create-home face
USER face
ENV FAPENGINE_CACHE=/home/face/.cache/fapengine EGL_PLATFORM=surfaceless
WORKDIR /work
ENTRYPOINT ["fapengine"]
CMD ["--help"]
