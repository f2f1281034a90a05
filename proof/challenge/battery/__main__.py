"""``python -m challenge.battery``: what is run before and after every change of the engine, from a clone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.common import reported

FolderOption = Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Where it goes.")]
PartsOption = Annotated[
    str,
    typer.Option(
        "--parts",
        metavar="A,B,...",
        help="Only some of real-like, outside, mujoco, recorded.",
        show_default=False,
    ),
]
JobsOption = Annotated[int, typer.Option("--jobs", metavar="J", min=1, help="Processes.")]
app = typer.Typer(name="python -m challenge.battery", add_completion=False, rich_markup_mode=None)


@app.command()
def draw(
    output: FolderOption,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed that all cases follow from.")] = 1,
    parts: PartsOption = "",
    jobs: JobsOption = 1,
) -> None:
    """Draw 20 real-like cases, 20 out of the library, and 10 on MuJoCo's arms where MuJoCo is installed.

    Example: python -m challenge.battery draw -o drawn --seed 7
    """
    with reported():
        from challenge.battery import sitting
        from challenge.battery.parts import chosen

        sitting.draw(output, seed, chosen(parts), jobs, typer.echo)


@app.command()
def sit(
    drawn: Annotated[Path, typer.Argument(metavar="DRAWN", help="A folder that 'draw' has filled.")],
    output: FolderOption,
    data: Annotated[
        Path | None,
        typer.Option("--data", metavar="DATA", help="Folder of real recordings.", show_default=False),
    ] = None,
    parts: PartsOption = "",
    jobs: JobsOption = 2,
    timeout: Annotated[
        float, typer.Option("--timeout", metavar="S", min=1.0, help="Seconds after which a case has failed.")
    ] = 3600.0,
) -> None:
    """Diagnose the drawn cases and real recordings with the engine that is importable; what has a result is left alone.

    Example: python -m challenge.battery sit drawn -o before --data recordings
    """
    with reported():
        from challenge.battery import sitting
        from challenge.battery.parts import chosen

        sitting.sit(drawn, output, chosen(parts), jobs=jobs, data=data, timeout=timeout, say=typer.echo)


@app.command()
def table(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Folders that 'sit' has filled.")],
) -> None:
    """Print one table: a column for each folder, a row for each figure, of the cases that all folders have.

    Example: python -m challenge.battery table before after
    """
    with reported():
        from challenge.battery import table as tables

        typer.echo(tables.table(folders), nl=False)


if __name__ == "__main__":
    app()
