# docker build -t candela . && docker run --rm -p 127.0.0.1:8080:8080 candela
# Both stages are Debian 13: one glibc, and its Mesa 25 renders up to twice as fast as Debian 12's 22.3.

FROM rust:1.95-slim-trixie AS build
WORKDIR /src
COPY . .
# Dependencies, once compiled, stay in the cache mounts: a change of Candela's own code builds only that.
RUN --mount=type=cache,target=/usr/local/cargo/registry \
    --mount=type=cache,target=/src/target \
    cargo build --release --locked && install target/release/candela /usr/local/bin/candela

FROM debian:trixie-slim
RUN apt-get update \
    && apt-get install --yes --no-install-recommends libvulkan1 mesa-vulkan-drivers \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --uid 10001 --create-home --home-dir /var/lib/candela candela
COPY LICENSE-MIT LICENSE-APACHE /usr/share/doc/candela/
COPY script/probe /usr/local/bin/candela-probe
COPY --from=build /usr/local/bin/candela /usr/local/bin/candela

USER candela
# What is written lies in the home folder: the data, and Mesa's cache of compiled shaders.
WORKDIR /var/lib/candela
VOLUME /var/lib/candela
# Loopback, the default, cannot be reached from outside a container. Mesa's device-select layer looks for a screen.
ENV CANDELA_LISTEN=0.0.0.0:8080 CANDELA_DATA=/var/lib/candela/data NODEVICE_SELECT=1
EXPOSE 8080
HEALTHCHECK --interval=10s --timeout=6s --start-period=30s CMD candela-probe "$CANDELA_LISTEN" /healthz
ENTRYPOINT ["candela"]
CMD ["serve"]
