"""The command line: thin commands that parse, call and print. Heavy imports stay inside them."""

from faultgauge.cli.app import app, main

__all__ = ["app", "main"]
