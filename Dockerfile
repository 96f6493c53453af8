# fapengine with everything that it draws, says and hears with, on a software renderer: for CI, and for a server.
#   docker build -t fapengine . && docker run --rm -v "$PWD:/work" fapengine say "Hello there." -o hello.mp4
#   docker run --rm -e FAPENGINE_TOKEN="$(openssl rand -hex 16)" -p 8110:8110 -p 9110:9110/udp fapengine serve --host 0.0.0.0
# Calls (serve --webrtc) use any free UDP port, so they need --network host: compose.yaml. A voice agent, likewise:
#   docker build -t fapengine-agents --target agents .
#   docker run --rm --network host -e FAPENGINE_TOKEN="$(openssl rand -hex 16)" fapengine-agents
FROM python:3.12-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends git && rm -rf /var/lib/apt/lists/*
COPY . /source
ARG EXTRAS=voice,video,recognizer,fast,live,batch,nats,webrtc
RUN pip wheel --no-cache-dir --wheel-dir /wheels /source/native "/source[$EXTRAS]"

FROM build AS build-agents
RUN pip wheel --no-cache-dir --wheel-dir /wheels /source/native "/source[$EXTRAS,agents]"

FROM python:3.12-slim-bookworm AS base
RUN apt-get update && apt-get install -y --no-install-recommends libegl1 libgl1 libgl1-mesa-dri libportaudio2 \
    && rm -rf /var/lib/apt/lists/*
RUN useradd --create-home face && mkdir -p /home/face/.cache/fapengine && chown -R face: /home/face
ENV FAPENGINE_CACHE=/home/face/.cache/fapengine EGL_PLATFORM=surfaceless PAGE=http://127.0.0.1:8110/
WORKDIR /work
# Whether the page of a server answers; commands that end by themselves end before it is asked.
HEALTHCHECK --interval=30s --timeout=5s --start-period=60s \
    CMD ["python", "-c", "import os, urllib.request; urllib.request.urlopen(os.environ['PAGE'], timeout=4)"]
ENTRYPOINT ["fapengine"]

FROM base AS agents
RUN --mount=type=bind,from=build-agents,source=/wheels,target=/wheels pip install --no-cache-dir --no-index /wheels/*.whl
USER face
ENV PAGE=http://127.0.0.1:7860/
CMD ["agent", "--host", "0.0.0.0"]

FROM base
RUN --mount=type=bind,from=build,source=/wheels,target=/wheels pip install --no-cache-dir --no-index /wheels/*.whl
USER face
CMD ["--help"]
