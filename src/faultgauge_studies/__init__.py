"""Whole jobs beside the product: the paper, published benchmarks, the drive of the demonstration.

`faultgauge reproduce`, `benchmark` and `demo` run them; nothing else of the product knows them.
"""
