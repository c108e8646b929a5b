"""The pages of a sweep: tables, charts and the document behind them."""

import json
import shlex
import sys
from pathlib import Path

from fusion_net.common.cli.command_line import as_override
from fusion_net.reports.ablation.compare import compare
from fusion_net.reports.ablation.jobs import collect, committed_in, find_jobs
from fusion_net.reports.ablation.pages import as_markdown, as_text
from fusion_net.reports.ablation.plot import plot_ablation
from fusion_net.reports.ablation.web_page import as_html
from fusion_net.reports.run_result import rounded


def write_ablation(
    folder: Path, *, results: Path | None, pages: Path, keep: bool = False, reference: str | None = None
) -> Path:
    """Writes ``ablation.{md,json,png,html}`` of the jobs in ``folder`` and in ``results``/NAME, both together: into ``folder``,
    or with ``keep``, without the HTML, into ``pages``/NAME after the jobs' results went to ``results``/NAME. Returns the folder
    written to."""
    if keep and results is None:
        raise ValueError("collect=true needs the folder that results are committed in; write results=DIR")
    committed = committed_in(results, folder)
    jobs = find_jobs(folder, committed)
    options = "".join(f" {key}" for key, is_set in (("collect=true", keep),) if is_set)
    typed = f"python -m fusion_net.reports.ablation {folder.as_posix()}{options}"
    typed += f" {shlex.quote(f'reference={as_override(reference)}')}" if reference else ""
    doc = {"sweep": folder.name, "command": typed} | compare(jobs, reference=reference)
    target = folder
    if keep and committed is not None:
        written = collect(jobs, committed)
        print(f"{committed}: {len(written)} results new or changed", file=sys.stderr)
        target = pages / folder.name
    target.mkdir(parents=True, exist_ok=True)
    (target / "ablation.json").write_text(json.dumps(rounded(doc), indent=1) + "\n", encoding="utf-8")
    (target / "ablation.md").write_text(as_markdown(doc), encoding="utf-8")
    plot_ablation(target / "ablation.png", doc)
    if not keep:
        (target / "ablation.html").write_text(as_html(doc), encoding="utf-8")
    print(as_text(doc))
    print(f"\nwrote {target}/ablation.{{md,json,png{'' if keep else ',html'}}}", file=sys.stderr)
    return target
