"""What mkdocs does beside reading ``docs/``: the references of settings and commands; links out of the site are plain text.

The pages are written for reading in the repository; there such a link opens the file.
"""

import re
import sys
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "docs"))
from commands import commands_reference  # noqa: E402
from settings import settings_reference  # noqa: E402

LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#:\s]+)(#[^)]*)?\)")
ROLE = re.compile(r":(?:class|func|meth|mod|attr):(?=<code>)")


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links to folders, and to files that are no part of the site, without their address; a reference below its page."""
    here = Path(config.docs_dir) / page.file.src_uri

    def kept(link: re.Match) -> str:
        target = (here.parent / link[2]).resolve()
        is_inside = target.is_relative_to(config.docs_dir)
        known = is_inside and files.get_file_from_path(target.relative_to(config.docs_dir).as_posix())
        return link[0] if known else link[1]

    reference = {
        "settings.md": lambda: settings_reference(ROOT / "configs"),
        "commands.md": lambda: commands_reference(ROOT),
    }
    return LINK.sub(kept, markdown) + "\n" + reference.get(page.file.src_uri, str)()


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Docstrings name other objects as Sphinx would; the role is left out."""
    return ROLE.sub("", html)
