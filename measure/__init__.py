"""Measurements of the program, each by its name: `make measure NAME=speed`, or `python -m measure speed` with the builds of `make build`.

A measurement is a module here with `TABLES`: tables of pages below `docs`, whose rows are measured one by one and written when they
are done, each with its date, its commit and the load of the machine. `--list` says which rows there are.
"""
