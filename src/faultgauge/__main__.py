"""`python -m faultgauge`: the same as `faultgauge`."""

from faultgauge.cli import main

main()
