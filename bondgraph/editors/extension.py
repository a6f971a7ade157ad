"""VS Code's extension as one file: the client of `vscode/`, the grammar, and the command that starts the server."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import BinaryIO

from ..version import VERSION
from .rules import textmate_grammar

SOURCES = Path(__file__).with_name("vscode")
_COPIED = ("extension.js", "diagram.js", "language-configuration.json")
_TYPES = """<?xml version="1.0" encoding="utf-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
  <Default Extension=".json" ContentType="application/json"/>
  <Default Extension=".js" ContentType="application/javascript"/>
  <Default Extension=".vsixmanifest" ContentType="text/xml"/>
</Types>
"""
_MANIFEST = """<?xml version="1.0" encoding="utf-8"?>
<PackageManifest Version="2.0.0" xmlns="http://schemas.microsoft.com/developer/vsx-schema/2011">
  <Metadata>
    <Identity Language="en-US" Id="{name}" Version="{version}" Publisher="{publisher}"/>
    <DisplayName>{displayName}</DisplayName>
    <Description xml:space="preserve">{description}</Description>
    <Categories>{categories}</Categories>
    <Properties>
      <Property Id="Microsoft.VisualStudio.Code.Engine" Value="{engine}"/>
      <Property Id="Microsoft.VisualStudio.Code.ExtensionKind" Value="workspace"/>
    </Properties>
  </Metadata>
  <Installation><InstallationTarget Id="Microsoft.VisualStudio.Code"/></Installation>
  <Dependencies/>
  <Assets><Asset Type="Microsoft.VisualStudio.Code.Manifest" Path="extension/package.json" Addressable="true"/></Assets>
</PackageManifest>
"""


def extension_files(command: Sequence[str]) -> Mapping[str, str]:
    """Texts of the files in the extension, by their names in it; `command` starts the server."""
    package = json.loads((SOURCES / "package.json").read_text(encoding="utf-8"))
    package["version"] = VERSION
    package["contributes"]["configuration"]["properties"]["bondgraph.command"]["default"] = list(command)
    named = {k: escape(package[k]) for k in ("name", "version", "publisher", "displayName", "description")}
    categories, engine = escape(",".join(package["categories"])), escape(package["engines"]["vscode"])
    return {
        "[Content_Types].xml": _TYPES,
        "extension.vsixmanifest": _MANIFEST.format(**named, categories=categories, engine=engine),
        "extension/package.json": json.dumps(package, indent=2),
        "extension/bondgraph.tmLanguage.json": json.dumps(textmate_grammar(), indent=1),
        **{f"extension/{n}": (SOURCES / n).read_text(encoding="utf-8") for n in _COPIED},
    }  # fmt: skip


def write_extension(stream: BinaryIO, command: Sequence[str]) -> None:
    """Write the extension, the same bytes each time."""
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in extension_files(command).items():
            entry = zipfile.ZipInfo(name)  # of 1980, the first year of the format
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, text)
