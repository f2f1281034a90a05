"""Ctrl-C and SIGTERM in a real process: while libraries load, inside a publication, lost in a destructor, twice at once."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="no such signals")
LOADING = """
import os, signal, sys
class Finder:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == "{library}":
            os.kill(os.getpid(), signal.{sent})
sys.meta_path.insert(0, Finder)
sys.argv = ["truepose", "schema", "-o", sys.argv[1]]
from truepose.__main__ import main
main()
"""
WORK = """
import os, signal, sys, time
from pathlib import Path
from truepose import faults
from truepose.files import atomic_directory
from truepose.stopping import stopping
out = Path(sys.argv[1])

def send():
    os.kill(os.getpid(), signal.SIGINT)

def publishing():
    with atomic_directory(out) as partial:
        (partial / "a.txt").write_text("a")
        sys.addaudithook(lambda event, arguments: event == "os.rename" and not stopping.number and send())
    time.sleep(60)

def before():
    with atomic_directory(out) as partial:
        (partial / "a.txt").write_text("a")
        send()
        time.sleep(60)

class Lost:
    def __del__(self):
        send()
        time.sleep(0)

def lost():
    Lost()
    time.sleep(60)

def twice():
    try:
        send()
        time.sleep(60)
    finally:
        send()
        (out / "ended").parent.mkdir()
        (out / "ended").touch()

def turned_off():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    faults.main(lambda: (send(), 0)[1])

faults.main(globals()[sys.argv[2]]) if sys.argv[2] != "turned_off" else turned_off()
"""


def ran(script: str, *words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", script, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=50, check=False)


@pytest.mark.parametrize(
    "library",
    ["truepose.cli", "typer", "truepose.identification.leaves.fleet.command", "importlib.resources"],
)
@pytest.mark.parametrize(("sent", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_while_libraries_load(library: str, sent: str, code: int, tmp_path: Path) -> None:
    done = ran(LOADING.format(library=library, sent=sent), tmp_path / "x.json")
    assert (done.returncode, done.stderr) == (code, "error: stopped; nothing was written\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("there", [False, True])
def test_a_publication_is_ended_first_and_told(there: bool, tmp_path: Path) -> None:
    if there:
        (tmp_path / "out").mkdir()
    done = ran(WORK, tmp_path / "out", "publishing")
    assert done.returncode == 130
    assert done.stderr == f"error: stopped; written before: {(tmp_path / 'out').resolve()}\n"
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "a.txt"]


@pytest.mark.parametrize("there", [False, True])
def test_before_it_nothing_is_written_and_nothing_left(there: bool, tmp_path: Path) -> None:
    if there:
        (tmp_path / "out").mkdir()
    done = ran(WORK, tmp_path / "out", "before")
    assert (done.returncode, done.stderr) == (130, "error: stopped; nothing was written\n")
    assert [path.name for path in tmp_path.rglob("*")] == ["out"] * there


def test_what_a_destructor_swallows_comes_again(tmp_path: Path) -> None:
    done = ran(WORK, tmp_path / "out", "lost")
    assert (done.returncode, done.stderr) == (130, "error: stopped; nothing was written\n")


def test_one_that_comes_twice_does_not_stop_what_is_put_in_order(tmp_path: Path) -> None:
    """A terminal and ``timeout`` send it to the process and to its group."""
    done = ran(WORK, tmp_path / "out", "twice")
    assert (done.returncode, done.stderr) == (130, "error: stopped; nothing was written\n")
    assert (tmp_path / "out" / "ended").exists()


def test_what_the_shell_has_turned_off_stays_so(tmp_path: Path) -> None:
    done = ran(WORK, tmp_path / "out", "turned_off")
    assert (done.returncode, done.stderr) == (0, "")


def test_what_another_command_of_this_process_wrote_is_not_this_ones() -> None:
    code = (
        "from truepose.stopping import stopping\n"
        "stopping.written.append('old.csv')\n"
        "stopping.listen()\n"
        "assert stopping.told() == 'stopped; nothing was written', stopping.told()\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


GENTLE = """
import os, signal, sys, time
from truepose import faults
from truepose.stopping import stopping

def work():
    with stopping.asked("ends soon\\n") as stop:
        for k in range(int(sys.argv[1])):
            os.kill(os.getpid(), getattr(signal, sys.argv[2]))
            time.sleep(1.2)
        print("asked" if stop() else "not asked")

faults.main(work)
"""


@pytest.mark.parametrize(
    ("times", "sent", "code", "said"),
    [
        (0, "SIGINT", 0, "not asked"),
        (1, "SIGINT", 0, "asked"),
        (2, "SIGINT", 130, ""),
        (1, "SIGTERM", 143, ""),
    ],
)
def test_where_results_can_be_concluded_a_first_signal_asks_and_a_second_ends(
    times: int, sent: str, code: int, said: str
) -> None:
    done = ran(GENTLE, times, sent)
    assert (done.returncode, done.stdout.strip()) == (code, said)
    assert done.stderr.startswith("ends soon") == (times > 0 and sent == "SIGINT")


ANYWHERE = """
import os, signal, sys
from truepose import faults, stopping

left = 0

def trace(frame, event, _):
    global left
    if frame.f_code.co_filename not in (faults.__file__, stopping.__file__):
        return None
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGINT)
    return trace

def ended(after):
    global left
    left = after
    sys.settrace(trace)
    faults.main(lambda: 0)

for after in range(1, 100):
    child = os.fork()
    if child == 0:
        try:
            ended(after)
        except SystemExit as exc:
            sys.settrace(None)
            os._exit(exc.code)
        except BaseException:
            os._exit(99)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


def test_whichever_line_of_the_beginning_and_the_end_it_comes_at() -> None:
    """Until nothing is left to be done it is told; then it ends the process as the system does; after the end it never came."""
    done = ran(ANYWHERE)
    codes = [int(line) for line in done.stdout.split()]
    heard = next(k for k, code in enumerate(codes) if code == 130)
    late = codes.index(0)
    before, told, after = codes[:heard], codes[heard:late], codes[late:]
    assert set(before) <= {-2, 99}, codes  # nobody listens yet: KeyboardInterrupt of Python's own
    assert set(told) <= {130, -2} and told.count(130) > 10, codes
    assert set(after) == {0}, codes
    assert done.stderr.count("error: stopped; nothing was written\n") == codes.count(130)
