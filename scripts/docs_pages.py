"""Hook of mkdocs: makes README.md the first page, and adds the other documents of the repository's root."""

from __future__ import annotations

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
PAGES = {"README.md": "index.md", "CONTRIBUTING.md": "CONTRIBUTING.md", "CHANGELOG.md": "CHANGELOG.md"}
ATTACHMENTS = ("CITATION.cff", "LICENSE")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the documents, with their links as seen from docs/."""
    for source, page in PAGES.items():
        files.append(File.generated(config, page, content=links_from_docs((ROOT / source).read_text())))
    for name in ATTACHMENTS:
        files.append(File.generated(config, name, content=(ROOT / name).read_text()))
    return files


def links_from_docs(text: str) -> str:
    """Return Markdown with the targets of links and images changed from the repository's root to docs/."""
    text = re.sub(r"\]\(docs/", "](", text)
    return re.sub(r"\]\(README\.md", "](index.md", text)
