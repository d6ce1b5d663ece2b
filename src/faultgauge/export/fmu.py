"""`export --to fmu`: co-simulation FMUs of FMI 2.0 and 3.0 around the printed step.

Both hold the same block of C and say the same; a host gives commands and measurements as inputs at
the beginning of a communication step and has the answer to them at its end.
"""

import hashlib
import io
import platform
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Sequence
from importlib import metadata
from math import isfinite
from string import Template

from faultgauge.export.c_project import plain
from faultgauge.export.compile import Member, Printed, print_step
from faultgauge.export.entry import UNNAMED
from faultgauge.export.fmu_sources import START, TIME, block_sources, fmi_source
from faultgauge.export.native import built, compiler
from faultgauge.export.request import Request
from faultgauge.export.sources import header, step_source, table_source
from faultgauge.plants.dimensions import BASE, read_unit, zero_of

__all__ = ["binary_here", "binary_in_words", "fmu_project"]

FLAGS = ("-fvisibility=hidden",)  # nothing but the standard's functions is seen
PLACES = {2: "binaries/linux64", 3: "binaries/x86_64-linux"}
MADE = (1980, 1, 1, 0, 0, 0)  # of every file in the archive: the same model, the same bytes
ENUMERATIONS = {"status": "", "reason": "reason", "event": "event"}  # what their codes begin with
TYPES = {"real": "Real", "wide": "Real", "bool": "Boolean", "int32_t": "Integer"}
NEW = {"Real": "Float64", "Boolean": "Boolean", "Integer": "Int32"}  # of FMI 3.0


def fmu_project(request: Request) -> dict[str, bytes]:
    """The files by name. Raises `InputError` where C cannot carry the model."""
    printed = print_step(
        request.step, request.name, single=request.single, fast_tanh=request.fast_tanh
    )
    version = metadata.version("faultgauge")
    banner = (
        f"/* Made by faultgauge {version} from the model of {plain(request.title)} with SHA-256\n"
        f"   {request.digest}. Export again rather than edit. */\n"
    )
    name = request.name
    inputs = tuple(each for each in printed.inputs if each.name != "t")
    step = {
        f"{name}.h": header(printed, banner),
        f"{name}.c": step_source(printed, banner),
        f"{name}_tables.c": table_source(printed, banner),
    }
    token = _token(version, *step.values())
    block = block_sources(printed, inputs, request.period, token, banner)
    around = {
        fmi: {f"{name}_fmi{fmi}.c": fmi_source(printed, fmi, request.period, banner)}
        for fmi in PLACES
    }
    # one library has the functions of both, which saves compiling the step again
    binary = built({**step, **block, **around[2], **around[3]}, FLAGS) if binary_here() else None
    files: dict[str, bytes] = {}
    for fmi, own in around.items():
        sources = {**step, **block, **own}
        described = _Description(request, printed, inputs, token, version, fmi)
        parts = {"modelDescription.xml": described.xml([n for n in sources if n.endswith(".c")])}
        parts |= {f"sources/{each}": text.encode() for each, text in sources.items()}
        if fmi == 3:
            parts["sources/buildDescription.xml"] = described.build(
                [n for n in sources if n.endswith(".c")]
            )
        if binary is not None:
            parts[f"{PLACES[fmi]}/{name}.so"] = binary
        files[f"{name}_fmi{fmi}.fmu"] = _zipped(parts)
    return {**files, "README.md": _readme(request, version).encode()}


def binary_here() -> bool:
    """Whether a binary for Linux on x86-64 can be built."""
    here = platform.system() == "Linux" and platform.machine() == "x86_64"
    return here and compiler() is not None


def _token(*texts: str) -> str:
    """What tells this FMU from others, as a GUID is written."""
    digest = hashlib.sha256("".join(texts).encode()).hexdigest()
    return f"{{{digest[:8]}-{digest[8:12]}-{digest[12:16]}-{digest[16:20]}-{digest[20:32]}}}"


def _zipped(parts: dict[str, bytes]) -> bytes:
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in parts.items():
            entry = zipfile.ZipInfo(name, MADE)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            file.writestr(entry, data)
    return archive.getvalue()


class _Description:
    """modelDescription.xml of FMI `fmi`, in the order that its schema asks for."""

    def __init__(
        self,
        request: Request,
        printed: Printed,
        inputs: Sequence[Member],
        token: str,
        version: str,
        fmi: int,
    ) -> None:
        self.request, self.printed, self.inputs = request, printed, inputs
        self.token, self.version, self.fmi = token, version, fmi

    def xml(self, sources: Sequence[str]) -> bytes:
        root = ET.Element("fmiModelDescription", fmiVersion=f"{self.fmi}.0")
        root.set("modelName", self.request.title)
        root.set("guid" if self.fmi == 2 else "instantiationToken", self.token)
        root.set("description", self.request.about)
        root.set("version", self.request.digest)
        root.set("generationTool", f"faultgauge {self.version}")
        root.set("variableNamingConvention", "flat")
        self._interface(root, sources)
        self._units(ET.SubElement(root, "UnitDefinitions"))
        self._types(ET.SubElement(root, "TypeDefinitions"))
        logs = ET.SubElement(root, "LogCategories")
        ET.SubElement(logs, "Category", name="logStatusError")
        ET.SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(self.request.period))
        variables = ET.SubElement(root, "ModelVariables")
        self._variables(variables)
        self._structure(ET.SubElement(root, "ModelStructure"))
        return _written(root)

    def _interface(self, root: ET.Element, sources: Sequence[str]) -> None:
        state = "FMUstate" if self.fmi == 2 else "FMUState"
        about = ET.SubElement(root, "CoSimulation", modelIdentifier=self.request.name)
        about.set("canHandleVariableCommunicationStepSize", "true")
        about.set(f"canGetAndSet{state}", "true")
        about.set(f"canSerialize{state}", "true")
        if self.fmi == 2:
            about.set("canNotUseMemoryManagementFunctions", "true")
            listed = ET.SubElement(about, "SourceFiles")
            for each in sources:
                ET.SubElement(listed, "File", name=each)

    def _units(self, parent: ET.Element) -> None:
        members = (*self.inputs, *self.printed.outputs)
        for text in sorted({each.unit for each in members if each.unit} | {"s"}):
            unit = ET.SubElement(parent, "Unit", name=text)
            base = _base(text)
            if base is not None:
                ET.SubElement(unit, "BaseUnit", base)

    def _types(self, parent: ET.Element) -> None:
        for output, start in ENUMERATIONS.items():
            if self.fmi == 2:
                one = ET.SubElement(parent, "SimpleType", name=_type_name(output))
                items = ET.SubElement(one, "Enumeration")
            else:
                items = ET.SubElement(parent, "EnumerationType", name=_type_name(output))
            for value, name in enumerate(self.printed.codes[start]):
                ET.SubElement(items, "Item", name=name, value=str(value))

    def _variables(self, parent: ET.Element) -> None:
        taken = {each.name for each in (*self.inputs, *self.printed.outputs)}
        clock = "time" if "time" not in taken else "time_"
        self._variable(parent, TIME, Member(clock, "real", (), "time", "s"), "independent")
        for k, each in enumerate(self.inputs):
            self._variable(parent, 1 + k, each, "input")
        for k, each in enumerate(self.printed.outputs):
            self._variable(parent, 1 + len(self.inputs) + k, each, "output")

    def _variable(self, parent: ET.Element, place: int, member: Member, causality: str) -> None:
        listed = _enumeration(member.name) if causality == "output" else None
        kind = "Enumeration" if listed else TYPES[member.kind]
        common = {"name": member.name, "valueReference": str(place)}
        if member.comment:
            common["description"] = member.comment
        common["causality"] = causality
        common["variability"] = "continuous" if causality == "independent" else "discrete"
        own = {"declaredType": _type_name(listed)} if listed else {}
        if member.unit:
            own["unit"] = member.unit
        if causality == "input":
            own["start"] = repr(START)
        if causality == "output":
            common["initial"] = "calculated"
        if self.fmi == 2:
            ET.SubElement(ET.SubElement(parent, "ScalarVariable", common), kind, own)
        else:
            ET.SubElement(parent, NEW.get(kind, kind), {**common, **own})

    def _structure(self, parent: ET.Element) -> None:
        """Outputs are those of the communication step before: none waits for an input."""
        first = 1 + len(self.inputs)
        places = range(first, first + len(self.printed.outputs))
        if self.fmi == 2:  # where in the list of variables, from 1 on
            for kind in ("Outputs", "InitialUnknowns"):
                group = ET.SubElement(parent, kind)
                for k in places:
                    ET.SubElement(group, "Unknown", index=str(k + 1), dependencies="")
        else:
            for kind in ("Output", "InitialUnknown"):
                for k in places:
                    ET.SubElement(parent, kind, valueReference=str(k), dependencies="")

    def build(self, sources: Sequence[str]) -> bytes:
        """sources/buildDescription.xml, of FMI 3.0."""
        root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
        made = ET.SubElement(
            root, "BuildConfiguration", modelIdentifier=self.request.name, platform="x86_64-linux"
        )
        files = ET.SubElement(made, "SourceFileSet", language="C99")
        for each in sources:
            ET.SubElement(files, "SourceFile", name=each)
        ET.SubElement(made, "Library", name="m", external="true")
        return _written(root)


def _written(root: ET.Element) -> bytes:
    ET.indent(root)
    return ET.tostring(root, "utf-8", xml_declaration=True) + b"\n"


def _enumeration(output: str) -> str | None:
    """Whose codes an output has."""
    event = output.startswith("event_") or output == UNNAMED
    return "event" if event else output if output in ("status", "reason") else None


def _type_name(output: str) -> str:
    return f"faultgauge.{output}"


def _base(text: str) -> dict[str, str] | None:
    """A unit in those of the SI; None where it is none, or has powers that are not whole."""
    try:
        unit = read_unit(text)
    except ValueError:
        return None
    powers = dict(zip((*BASE, "rad"), (*unit.dimension, unit.angle), strict=True))
    if not isfinite(unit.scale) or any(each.denominator != 1 for each in powers.values()):
        return None
    found = {name: str(int(each)) for name, each in powers.items() if each}
    if unit.scale != 1:
        found["factor"] = repr(unit.scale)
    if zero := zero_of(text):
        found["offset"] = repr(zero)
    return found


README = """# $title

$about

`${name}_fmi2.fmu` (FMI 2.0) and `${name}_fmi3.fmu` (FMI 3.0), both for co-simulation: import one in
the tool that simulates or records the plant, and connect to its inputs what is commanded and what
is measured.

- **Time**: a sample is taken at the beginning of a communication step, with the inputs as they are
  then; the outputs at its end are the answer. Samples come every $period s: let the communication
  step be that, or a whole part of it (then some steps take none). A longer one is refused.
- **Not sampled** is NaN at an input. Before the first sample the outputs are NaN, the status is
  NOT_JUDGED.
- **State**: it can be kept, set again and turned into bytes; with the same samples the same numbers
  follow to the bit.
- **Inside**: modelDescription.xml with units and descriptions, the sources in C99, which need
  nothing but `<math.h>` and a heap for instances, $binary

Made by faultgauge $version from the model with SHA-256 `$digest`.
"""


def _readme(request: Request, version: str) -> str:
    return Template(README).substitute(
        title=request.title,
        about=request.about,
        name=request.name,
        period=f"{request.period:g}",
        binary=f"and {binary_in_words()}.",
        version=version,
        digest=request.digest,
    )


def binary_in_words() -> str:
    """Which binary an FMU that is made here has, and why none."""
    if binary_here():
        return "a binary for Linux on x86-64"
    if compiler() is None:
        return "no binary: no C compiler was found; tools that compile FMUs take the sources"
    return "no binary, which is built on Linux on x86-64; tools that compile FMUs take the sources"
