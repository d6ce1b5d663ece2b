"""`faultgauge estimate MODEL -`: telemetry in, answers out, row by row."""

import json
import sys
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import IO, TYPE_CHECKING

from faultgauge.cli import options
from faultgauge.cli.streaming import Interrupt, RowWriter, Skipped, input_lines, while_read
from faultgauge.cli.view import View
from faultgauge.errors import InputError

if TYPE_CHECKING:
    from faultgauge.detection.answer.misfit import Misfit
    from faultgauge.detection.posterior.glitches import Glitch
    from faultgauge.detection.rows.residual import Reference
    from faultgauge.detection.stream import Said, Stream
    from faultgauge.plants.model import Model

__all__ = ["answer"]


def answer(
    model: Path,
    observer: str,
    reference: "Reference",
    time: str | None,
    time_format: str | None,
    maps: Sequence[str] | None,
    form: str,
    events: Path | None,
    view: bool,
    strict: bool,
) -> None:
    """Answer standard input until it ends; an interrupt ends it too, and loses no row. Rows
    that are no telemetry are left out; `strict`, they end it."""
    if view and not sys.stderr.isatty():
        raise InputError("--view draws on standard error, which is no terminal here; leave it out.")
    from faultgauge.detection.posterior.uncalibrated import uncalibrated
    from faultgauge.detection.stream import Stream
    from faultgauge.identification.samples import column_names
    from faultgauge.plants.model import load_model
    from faultgauge.reporting.words.reliance import doubt
    from faultgauge.reporting.words.unjudged import observer_sentence, unjudged_sentence
    from faultgauge.telemetry.stream import read_stream
    from faultgauge.verbs.reading import said_before

    fitted = load_model(model)
    stream = Stream(fitted, observer=observer, reference=reference)
    required, optional = column_names(fitted.plant.signals)
    skipped = Skipped()
    leave_out = {} if strict else {"skip": skipped}
    with Interrupt() as interrupt, while_read(), ExitStack() as stack:
        stack.callback(skipped.summary)
        samples = read_stream(
            input_lines(interrupt),
            time=time,
            maps=maps or (),
            names=required,
            optional=optional,
            units=fitted.plant.signals.units,
            time_format=time_format,
            before=said_before(fitted),
            note=lambda text: options.say(f"note: {text}"),
            **leave_out,
        )
        lines = stack.enter_context(_opened(events)) if events else None
        shown = stack.enter_context(View(fitted)) if view else None
        speaker = _Speaker(fitted, stream, form, lines, shown)
        stack.callback(speaker.summary)
        if observer == "bank" and uncalibrated(fitted):
            options.say(unjudged_sentence(fitted))
        elif observer != "bank":
            options.say(observer_sentence(fitted))
        elif (reason := doubt(fitted)) is not None:
            options.warn([reason])
        for several in samples:
            speaker.say(stream.push(*several))
        speaker.say(stream.finish())
    options.warn(stream.refused)


def _opened(path: Path) -> IO[str]:
    try:
        return open(path, "w", buffering=1)  # a line is there as soon as it is written
    except OSError as failure:
        raise InputError(f"{path}: cannot be written ({failure.strerror}).") from None


class _Speaker:
    """Puts what is said where it belongs: rows to stdout, alarms and events to stderr and FILE."""

    def __init__(
        self,
        model: "Model",
        stream: "Stream",
        form: str,
        lines: IO[str] | None,
        view: View | None,
    ) -> None:
        self.model, self.stream, self.lines, self.view = model, stream, lines, view
        self.units = {fault.name: fault.unit for fault in model.plant.signals.faults}
        # a view and rows on the same terminal would overwrite each other
        self.writer = None if view and sys.stdout.isatty() else RowWriter(form)
        self.glitches = 0

    def say(self, said: Iterable["Said"]) -> None:
        from faultgauge.detection import decisions
        from faultgauge.detection.answer import estimation
        from faultgauge.detection.answer.misfit import Misfit

        faults = self.model.plant.signals.fault_names
        for each in said:
            if isinstance(each, estimation.Estimated | decisions.Decision):
                if isinstance(each, estimation.Estimated):
                    columns = estimation.table([each], faults)
                else:
                    columns = decisions.table([each], faults)
                rows = [
                    dict(zip(columns, cells, strict=True))
                    for cells in zip(*columns.values(), strict=True)
                ]
                if self.writer:
                    self.writer.write(*rows)
                if isinstance(each, decisions.Decision) and each.glitches:
                    self.odd(each.glitches)
                if self.view:
                    self.view.rows(rows)
            elif isinstance(each, Misfit):
                self.misfit(each)
            else:
                self.event(each)

    def event(self, said: "Said") -> None:
        from faultgauge.detection import decisions
        from faultgauge.detection.posterior.events import Alarm, BankEvent, Unnamed
        from faultgauge.detection.words import UNDECLARED, moment
        from faultgauge.reporting.words.event_sentence import finding
        from faultgauge.reporting.words.reliance import doubt, headed
        from faultgauge.reporting.words.unnamed import alarm_sentence
        from faultgauge.telemetry.writing import stamp

        assert isinstance(said, Alarm | BankEvent | Unnamed)
        clock, step = self.stream.clock, self.stream.pace or 0.0
        start = {"start_clock": stamp(clock, said.start)}
        if isinstance(said, Unnamed):
            sentence = alarm_sentence(self.model, said, step, clock)
            line = {"said": "unnamed", "run": said.run, "start": said.start, "end": said.end}
            line |= {"sentence": sentence, **start, "end_clock": stamp(clock, said.end)}
        elif isinstance(said, Alarm):
            line = {"said": "alarm", **asdict(said), **start}
        else:
            line = {"said": "event", **decisions.as_dicts([said], clock)[0]}
        if self.lines:
            reason = doubt(self.model)
            line |= {} if reason is None else {"doubt": reason}
            print(json.dumps(line, allow_nan=False), file=self.lines)
        at = moment(clock, said.start, step)
        if isinstance(said, Unnamed):
            text = f"over: {alarm_sentence(self.model, said, step, clock)}"
        elif isinstance(said, BankEvent):
            text = f"event: {'; '.join(finding(said, self._unit(said.fault), step, clock))}"
        elif said.fault is None:
            text = f"alarm at {at}, without a name yet; {said.reason}"
        elif said.size is None:
            text = f"alarm: {UNDECLARED}, told at {at}"
        else:
            size = f"{said.size:+.3g} {self._unit(said.fault)}".rstrip()
            text = f"alarm: {said.fault} {size}, told at {at}"
        if not isinstance(said, Unnamed):  # whose sentence has its head
            text = headed(self.model, text)
        if self.view:
            self.view.event(text)
        else:
            options.say(text)

    def _unit(self, fault: str) -> str:
        from faultgauge.plants.signals import spoken

        return spoken(self.units.get(fault, ""))

    def odd(self, found: Sequence["Glitch"]) -> None:
        """A warning of the first sample that nothing explains; all are counted."""
        from faultgauge.reporting.words.glitches import sentences
        from faultgauge.telemetry.stream import SOURCE

        if not self.glitches:
            options.warn(sentences(SOURCE, found[:1], None, self.stream.pace or 0.0))
        self.glitches += len(found)

    def summary(self) -> None:
        """How many there were."""
        from faultgauge.telemetry.stream import SOURCE

        if self.glitches > 1:
            options.warn([f"{SOURCE}: {self.glitches} samples in all are such, and moved nothing"])

    def misfit(self, said: "Misfit") -> None:
        """A warning about the whole stream."""
        if self.lines:
            content = {"said": "warning", **asdict(said)}
            print(json.dumps(content, allow_nan=False), file=self.lines)
        if self.view:
            self.view.event(f"warning: {said.text}")
        else:
            options.warn([said.text])
