"""`faultgauge presets`"""

from typing import Annotated

import typer

from faultgauge.cli import options

__all__ = ["presets"]


def presets(
    name: Annotated[str | None, typer.Argument(help="Preset to print, to be edited.")] = None,
    json: options.Json = False,
) -> None:
    """List the plant files that come with faultgauge, or print one to edit it."""
    import tomllib

    from faultgauge.errors import InputError
    from faultgauge.plants.expression import unknown
    from faultgauge.plants.plant_file import presets as shipped

    found = shipped()
    if name is not None:
        if name not in found:
            raise InputError(f"{unknown('preset', name, found)}.")
        if json:
            options.print_json({"preset": name, "text": found[name]})
        else:
            options.tell(found[name].rstrip("\n"))
        return
    files = {each: tomllib.loads(text) for each, text in found.items()}
    if json:
        options.print_json({"presets": {each: file["name"] for each, file in files.items()}})
        return
    width = max(map(len, files))
    for each, file in files.items():
        signals = f"{', '.join(file['inputs'])} -> {', '.join(file['outputs'])}"
        options.tell(f"{each:{width}}  {file['name']}: {signals}")
    options.say("print one to edit it: faultgauge presets NAME > plant.toml")
