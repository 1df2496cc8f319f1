"""Pages of the documentation site that lie elsewhere: a hook of MkDocs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files


def on_files(files: Files, config: Any) -> Files:
    """Add CONTRIBUTING.md, whose links lead from the repository's root."""
    text = (Path(config.config_file_path).parent / "CONTRIBUTING.md").read_text().replace("](docs/", "](")
    files.append(File.generated(config, "contributing.md", content=text))
    return files
