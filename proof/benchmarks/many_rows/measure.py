"""One diagnosis as the command runs it, its stages timed: prints one JSON object."""

from __future__ import annotations

import hashlib
import json
import resource
import sys
import tempfile
import time
from pathlib import Path

from truepose.commands.common import gated
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.report.files import write_diagnosis


class Stages:
    """Seconds of each stage, by the text that began it."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._name, self._since = "", time.monotonic()

    def say(self, text: str) -> None:
        """A stage begins; the one before has ended."""
        now = time.monotonic()
        if self._name:
            self.seconds[self._name] = self.seconds.get(self._name, 0.0) + now - self._since
        self._name, self._since = text, now


def main(machine: str, recording: str) -> None:
    """Run and print."""
    began, stages = time.monotonic(), Stages()
    stages.say("reading and checking")
    loaded, rows, caution = gated(Path(machine), [Path(recording)])
    result = diagnose(loaded, rows, progress=stages.say)
    stages.say("writing the report")
    with tempfile.TemporaryDirectory() as folder:
        write_diagnosis(result, Path(folder), caution=caution)
        digest = hashlib.sha256((Path(folder) / "diagnosis.json").read_bytes()).hexdigest()
        size = (Path(folder) / "report.html").stat().st_size
    stages.say("")
    found = {
        "rows": len(rows),
        "seconds": time.monotonic() - began,
        "processor": time.process_time(),
        "gigabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
        "stages": stages.seconds,
        "report": size,
        "verdict": result.verdict,
        "digest": digest,
        "names": [
            [f.effect, list(f.place), f.probability, {n: [q.value, q.std] for n, q in f.parameters.items()}]
            for f in result.findings
        ],
    }
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
