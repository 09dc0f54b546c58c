# PBPO Studio in a container: built in one stage, served from another that has no compiler and no pip cache.
# The base's digest belongs here as well; docs/operations.md says how to add it.

FROM python:3.11-slim-bookworm AS build
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
WORKDIR /srv/pbpo
RUN python -m venv /opt/venv
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY app ./app
# Editable: templates, static files and migrations lie beside the package, here and in the next stage.
RUN /opt/venv/bin/python -m pip install --constraint constraints.txt --editable '.[postgresql,s3]'

FROM python:3.11-slim-bookworm
# pg_dump and pg_restore, for `pbpo backup`: of the version of the postgres service or newer. Fonts, for
# reports as PDF: most scripts, and Chinese, Japanese and Korean.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends postgresql-client-15 fonts-noto-core fonts-noto-cjk \
    && rm -rf /var/lib/apt/lists/* \
    && groupadd --system --gid 10001 pbpo \
    && useradd --system --uid 10001 --gid 10001 --home-dir /nonexistent --no-create-home --shell /usr/sbin/nologin pbpo \
    && install --directory --owner=pbpo --group=pbpo --mode=0700 /data /ledger /backups \
    && install --directory --owner=pbpo --group=pbpo --mode=0755 /media /own-videos
WORKDIR /srv/pbpo
COPY --from=build /opt/venv /opt/venv
COPY --from=build /srv/pbpo ./
COPY migrations ./migrations
COPY templates ./templates
COPY static ./static
ENV PATH=/opt/venv/bin:$PATH \
    HOME=/tmp \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    OMP_NUM_THREADS=1 \
    PBPO_DATA_DIR=/data \
    PBPO_MEDIA_DIR=/media \
    PBPO_OWN_VIDEOS_DIR=/own-videos \
    PBPO_DELETIONS_FILE=/ledger/deletions.log \
    PBPO_PRODUCTION=true \
    PBPO_SECURE_COOKIES=true
USER 10001:10001
EXPOSE 8000
HEALTHCHECK --interval=30s --timeout=5s --start-period=60s \
    CMD ["python", "-c", "import urllib.request; urllib.request.urlopen('http://127.0.0.1:8000/healthz', timeout=4)"]
ENTRYPOINT ["pbpo"]
CMD ["serve", "--host", "0.0.0.0"]
