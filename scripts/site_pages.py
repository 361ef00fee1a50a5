"""Pages of the site that no file in `docs` holds: mkdocs calls this module (`mkdocs.yml`) for `make site`.

Made while the site is built: the commands, from the typer application; the public names, from each `__init__.pyi`; the
keys of JSON results, from their schemas; and a page for every file of the repository that a page links to: a copy of
the site needs neither network nor checkout.
"""

from __future__ import annotations

import ast
import json
import logging
import os
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

import click
import typer
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

from scripts.check_docs import CODE_SPAN, FENCE, LINK, ROOT
from scripts.json_documents import schemas
from scripts.json_documents.parts import Document

DOCS = ROOT / "docs"
SOURCE = ROOT / "src" / "wrenchgap"
IN_NAVIGATION = ("CHANGELOG.md", "CONTRIBUTING.md")
"""Pages of the repository's root that the navigation names."""
LANGUAGES = {".py": "python", ".pyi": "python", ".toml": "toml", ".c": "c", ".h": "c", ".sh": "sh", ".json": "json"}
log = logging.getLogger("mkdocs.hooks.site_pages")


def math(source: str, language: str, css_class: str, options: Any, md: Any, **_: Any) -> str:
    """A fenced block `math` as MathML, one equation a line of the block."""
    lines = [convert(line, display="block") for line in source.split("\n\n") if line.strip()]
    return f'<div class="{css_class}">{"".join(lines)}</div>'


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Write out each `FOLDER/*` of the navigation."""
    named = set(_named(config.nav))
    config.nav = list(_expanded(config.nav, named))
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages and schemas that are made."""
    for name, text in made().items():
        files.append(File.generated(config, name, content=text))
    for command, schema in schemas().items():
        files.append(File.generated(config, f"reference/schemas/{command}.json", content=json.dumps(schema, indent=1)))
    todo = [DOCS / file.src_uri for file in files.documentation_pages() if file.abs_src_path]
    todo += [ROOT / name for name in IN_NAVIGATION]
    seen = set(todo)
    for path in todo:
        if DOCS not in path.parents:
            where = InclusionLevel.INCLUDED if path.name in IN_NAVIGATION else InclusionLevel.NOT_IN_NAV
            files.append(File.generated(config, page_of(path), content=content(path), inclusion=where))
        if path.suffix == ".md":
            linked = {target for _, target, _ in links(path.read_text(encoding="utf-8"), path)}
            fresh = {p for p in linked if DOCS not in p.parents and p != DOCS and p.exists()} - seen
            todo += sorted(fresh)
            seen |= fresh
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Point the links that leave `docs` to the pages made for them."""
    here = page.file.src_uri
    if here in made():
        return markdown
    path = DOCS / here if (DOCS / here).exists() else ROOT / here.removeprefix("source/")
    for written, target, anchor in links(markdown, path):
        if DOCS in target.parents and DOCS in path.parents:
            continue
        if not target.exists():
            log.warning("%s: link to %s: no such file", here, written)
        relative = os.path.relpath(page_of(target), Path(here).parent)
        markdown = markdown.replace(f"]({written})", f"]({relative}{anchor})")
    return markdown


@cache
def made() -> dict[str, str]:
    """Every generated page by its place in the site."""
    pages = {"reference/commands.md": commands()}
    pages |= {f"reference/schemas/{command}.md": keys(command) for command in schemas()}
    entries: dict[str, str] = {}
    for stub in sorted(SOURCE.glob("__init__.pyi")) + sorted(SOURCE.glob("*/__init__.pyi")):
        package = ".".join(("wrenchgap", *stub.parent.relative_to(SOURCE).parts))
        pages[f"reference/api/{package}.md"] = public_names(stub, package, entries)
    return pages


def public_names(stub: Path, package: str, entries: dict[str, str]) -> str:
    """A page with an entry for each name that a package offers, or a link to that of an earlier page (`entries`)."""
    lines = [f"# {package}\n"]
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            for name in (alias.name for alias in node.names):
                whole = f"{package}.{node.module}.{name}"
                first = entries.setdefault(whole, package)
                if first == package:
                    lines.append(f"::: {whole}\n    options:\n      heading: {name}\n")
                else:
                    lines.append(f"## {name}\n\nThe same as [`{first}.{name}`]({first}.md#{whole}).\n")
    return "\n".join(lines)


PART_OF = {"Comparison": "compare", "WhereBody": "where", "ExplainBody": "explain", "Timing": "inspect"}
"""Parts of several documents, and the command whose page has their keys."""


def keys(command: str) -> str:
    """A page with every key of a command's document, its type and, where the name does not say it, its meaning."""
    schema = schemas()[command]
    shared = [key for key in get_type_hints(Document) if key in schema["properties"]]
    own = [key for key in schema["properties"] if key not in shared]
    head = f"# {command}\n\n`{schema['$id']}`, [JSON schema]({command}.json). See [JSON results](../../json.md).\n"
    lines = [
        head,
        *_key_table(own, schema, command),
        "\n## Common to all commands\n",
        *_key_table(shared, schema, command),
    ]
    return "\n".join(lines) + "\n"


def _key_table(named: list[str], schema: dict[str, Any], command: str) -> Iterator[str]:
    yield from ("| key | type | meaning |", "|---|---|---|")
    for key in named:
        yield from _key_rows(key, schema["properties"][key], schema.get("$defs", {}), command)


def _key_rows(key: str, value: dict[str, Any], parts: dict[str, Any], command: str) -> Iterator[str]:
    """The row of a key, and those of the keys below it."""
    kind, below, path = _kind(value, parts, command)
    words = re.sub(r"\bdocs/([\w-]+)\.md", r"[\1](../../\1.md)", value.get("description", ""))
    yield f"| `{key}` | {kind} | {' '.join(words.split())} |".replace("  |", " |")
    for name, inner in below.items():
        yield from _key_rows(f"{key}{path}.{name}", inner, parts, command)


def _kind(value: dict[str, Any], parts: dict[str, Any], command: str) -> tuple[str, dict[str, Any], str]:
    """The type of a value in words; the keys below it; and what leads there from the key."""
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        page = PART_OF.get(name, command)
        if page != command:
            return f"as [{page}]({page}.md)", {}, ""
        return (
            ("object", parts[name]["properties"], "")
            if "properties" in parts[name]
            else _kind(parts[name], parts, command)
        )
    if "anyOf" in value:
        found = [_kind(one, parts, command) for one in value["anyOf"]]
        _, below, path = next((one for one in found if one[1]), found[0])
        return " or ".join(kind for kind, _, _ in found), below, path
    if "const" in value or "enum" in value:
        return ", ".join(f"`{one}`" for one in value.get("enum", [value.get("const")])), {}, ""
    if value.get("type") == "array":
        kind, below, path = _kind(value["items"], parts, command)
        return f"list of {value['minItems']}: {kind}" if "minItems" in value else f"list: {kind}", below, f"[]{path}"
    if isinstance(value.get("additionalProperties"), dict):
        kind, below, path = _kind(value["additionalProperties"], parts, command)
        return f"by name: {kind}", below, f".*{path}"
    return value.get("type", "any"), {}, ""


def commands() -> str:
    """A page with the usage, the arguments and the options of each command."""
    from wrenchgap.replay.cli.main import app

    group = typer.main.get_command(app)
    return "# Commands\n\n" + "\n".join(_command(group, "wrenchgap"))


def _command(command: click.Command, name: str) -> Iterator[str]:
    ctx = click.Context(command, info_name=name)
    usage = " ".join([name, *command.collect_usage_pieces(ctx)])
    yield f"## {name}\n\n{_plain(command.help or '')}\n\n```text\n{usage}\n```\n"
    rows = [(f"`{', '.join(p.opts)}`", _plain(getattr(p, "help", None) or "")) for p in command.get_params(ctx)]
    yield "| option | meaning |\n|---|---|\n" + "".join(f"| {a} | {b} |\n" for a, b in rows)
    for below, one in getattr(command, "commands", {}).items():
        yield from _command(one, f"{name} {below}")


def _plain(text: str) -> str:
    text = re.sub(r"\[/?(bold|dim|italic|cyan|green|yellow|red)[^\]]*\]", "", text)
    return " ".join(text.split()).replace("|", r"\|").replace("<", "&lt;") if "\n\n" not in text else text


def links(text: str, path: Path) -> Iterator[tuple[str, Path, str]]:
    """Each relative link of a page to a file: as it is written, the file, and the anchor."""
    for written in dict.fromkeys(LINK.findall(CODE_SPAN.sub("", FENCE.sub("", text)))):
        place, _, anchor = written.partition("#")
        if place and not re.match(r"[a-z][a-z0-9+.-]*:", place):
            yield written, Path(os.path.normpath(path.parent / place)), f"#{anchor}" if anchor else ""


def page_of(path: Path) -> str:
    """Where the site keeps a file of the repository."""
    if DOCS in path.parents:
        return path.relative_to(DOCS).as_posix()
    name = path.relative_to(ROOT).as_posix()
    return name if name in IN_NAVIGATION else f"source/{name}" + ("" if path.suffix == ".md" else ".md")


def content(path: Path) -> str:
    """A file of the repository as a page."""
    title = f"# {path.relative_to(ROOT).as_posix()}\n\n"
    if path.is_dir():
        return title + "".join(f"- {p.name}\n" for p in sorted(path.iterdir()))
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        return text
    if path.suffix == ".ipynb":
        cells = [("".join(cell["source"]), cell["cell_type"]) for cell in json.loads(text)["cells"]]
        return title + "\n\n".join(s if kind == "markdown" else _fenced(s, "python") for s, kind in cells)
    return title + _fenced(text, LANGUAGES.get(path.suffix, "text"))


def _fenced(text: str, language: str) -> str:
    return f"````{language}\n{text.rstrip()}\n````\n"


def _named(nav: Any) -> Iterator[str]:
    if isinstance(nav, str):
        yield nav
    for one in nav if isinstance(nav, list) else nav.values() if isinstance(nav, dict) else ():
        yield from _named(one)


def _expanded(nav: list[Any], named: set[str]) -> Iterator[Any]:
    for one in nav:
        if isinstance(one, str) and one.endswith("/*"):
            pages = {p.relative_to(DOCS).as_posix() for p in DOCS.glob(f"{one}.md")} | {
                name for name in made() if Path(name).match(one)
            }
            yield from sorted(pages - named)
        elif isinstance(one, dict):
            yield {
                key: list(_expanded(value, named)) if isinstance(value, list) else value for key, value in one.items()
            }
        else:
            yield one
