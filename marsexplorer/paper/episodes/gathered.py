"""The results of figures 6 and 7 on disk: in the folders of jobs, or gathered in small files, as data/paper has them."""

from __future__ import annotations

from pathlib import Path

from marsexplorer.paper.episodes.play import Line, read_lines, write_lines


def read_results(folder: Path, figure: int) -> list[Line]:
    """Return the results of a figure in a folder, of jobs (NAME/result.jsonl) or gathered (NAME.jsonl), in order of name.

    Where a folder has both of the same policy, level and size, the job's counts. FileNotFoundError when there is none.
    """
    gathered = sorted(folder.glob(f"figure{figure}-*.jsonl"))
    files = [*gathered, *sorted(folder.glob(f"figure{figure}-*/result.jsonl"))]
    lines = {_place_of(line): line for path in files for line in read_lines(path)}
    if not lines:
        raise FileNotFoundError(
            f"no results of figure {figure} in {folder}: expected folders figure{figure}-*/ with a result.jsonl; "
            f"run `marsexplorer paper --figure {figure}` first"
        )
    return list(lines.values())


def _place_of(line: Line) -> tuple[object, ...]:
    """Return what two results may not share: the policy or the walks, the level and the size."""
    return line.get("policy"), line.get("null"), line.get("level"), line["rows"]


def gather(folder: Path, figure: int, target: Path) -> list[Path]:
    """Write the results of a figure into one file a policy, figureN-POLICY.jsonl, and one for the null; return the paths."""
    target.mkdir(parents=True, exist_ok=True)
    groups: dict[str, list[Line]] = {}
    for line in read_results(folder, figure):
        groups.setdefault(line.get("policy", "null"), []).append(line)
    paths = [target / f"figure{figure}-{name}.jsonl" for name in groups]
    for path, lines in zip(paths, groups.values(), strict=True):
        write_lines(path, lines)
    return paths
