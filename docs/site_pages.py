"""Pages of the documentation site that lie elsewhere or are generated: a hook of MkDocs."""

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

from tools.reference_pages import SITE_PAGES


def on_files(files: Files, config: Any) -> Files:
    """Add CONTRIBUTING.md, whose links lead from the repository's root."""
    text = (Path(config.config_file_path).parent / "CONTRIBUTING.md").read_text().replace("](docs/", "](")
    files.append(File.generated(config, "contributing.md", content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Append the tables of arrays and settings to their pages."""
    generate = SITE_PAGES.get(page.file.src_uri)
    return f"{markdown}\n{generate()}" if generate else markdown
