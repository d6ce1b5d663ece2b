"""The verbs: what the command line does, as functions that give one object each.

`read`, `plant` and `load` bring things in; `fit`, `evaluate`, `calibrate`, `estimate`, `rehearse`,
`simulate` and `check` give a `Result`: it prints as its sentences and has `.plot()`,
`.report(path)`, `.to_frame()` and `.as_dict()`. The command line is these, and printing.
"""
