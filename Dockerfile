# An image of the commands with MPI and USD. Built by: docker build --tag drapery .
FROM rust:1.95-slim-bookworm AS build
RUN apt-get update && \
    apt-get install --yes --no-install-recommends g++ pkg-config libhdf5-dev libopenmpi-dev libclang-dev && \
    rm -rf /var/lib/apt/lists/*
WORKDIR /drapery
COPY . .
RUN cargo build --release --locked --package drapery --package drapery-assets --features drapery/mpi,drapery/usd --ignore-rust-version && \
    strip target/release/drapery target/release/drapery-assets

FROM debian:bookworm-slim
# With the client of ssh, by which mpirun starts ranks on other machines.
RUN apt-get update && \
    apt-get install --yes --no-install-recommends openmpi-bin openssh-client libhdf5-103-1 && \
    rm -rf /var/lib/apt/lists/*
COPY --from=build /drapery/target/release/drapery /drapery/target/release/drapery-assets /usr/local/bin/
COPY sample_assets/scenes /usr/local/share/drapery/scenes
COPY LICENSE-MIT LICENSE-APACHE /usr/local/share/drapery/
# Processes in a container may not read each other's memory; ranks that share a machine then copy messages twice.
ENV OMPI_MCA_btl_vader_single_copy_mechanism=none
# mpirun needs a home, also for a user of no name (`docker run --user`).
ENV HOME=/tmp
WORKDIR /shot
ENTRYPOINT ["drapery"]
CMD ["--help"]
