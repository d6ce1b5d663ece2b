"""What the paper claims, measured: one claim per file, each with its figure and its verdict.

A file has `measure(bench) -> (figures, traces)`, numbers of one seed under a name of their own as
in results.json and the curves to draw, and `section(results, traces) -> Section` for the report.
"""
