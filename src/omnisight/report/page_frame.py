"""The frame that all reports share: one HTML page with a verdict, key figures, and one section per topic."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

from omnisight.report.html import Markup, element
from omnisight.report.section import Section
from omnisight.report.security_policy import security_policy


@dataclass(frozen=True)
class Page:
    """The content of a report.

    Attributes
    ----------
    title
        Title of the window.
    header
        Heading of the page.
    summary
        Verdict and key figures.
    sections
        The sections.
    command
        Command line that made the result.
    data
        The result as JSON, for programs.
    scripts
        Names of the scripts of this package that the page runs, in order.
    before, after
        Definitions of drawings and elements that the scripts use, before and after the content.
    """

    title: str
    header: Markup
    summary: Markup
    sections: Sequence[Section]
    command: str
    data: Markup
    scripts: tuple[str, ...]
    before: Markup | None = None
    after: Markup | None = None


def render(page: Page) -> str:
    """Return the HTML text of a page that loads nothing from the network."""
    style = _read("style.css")
    script = '"use strict";\n\n' + "\n".join(map(_read, page.scripts))
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=security_policy(style, script)),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("title", page.title),
        element("style", Markup(style)),
    )
    links = [element("a", section.title, href=f"#{section.id}") for section in page.sections]
    body = element(
        "body",
        page.before,
        element("header", page.header),
        element(
            "main",
            page.summary,
            element("nav", *links, aria_label="Sections of this report"),
            *map(_section, page.sections),
        ),
        element("footer", element("p", "Command: ", element("code", page.command))),
        page.after,
        page.data,
        element("script", Markup(script)),
    )
    return f"<!DOCTYPE html>\n{element('html', head, body, lang='en')}\n"


def _read(name: str) -> str:
    return files("omnisight.report").joinpath(name).read_text("utf-8")


def _section(section: Section) -> Markup:
    guide = section.guide
    paragraphs = (("Content", guide.content), ("Expected", guide.expected), ("Action", guide.action))
    aside = element(
        "aside",
        element("h3", "How to read this"),
        *(element("p", element("b", name), " ", text) for name, text in paragraphs),
        class_="guide",
    )
    body = element("div", section.body, class_="body")
    return element(
        "section",
        element("h2", section.title),
        element("div", body, aside, class_="wide" if section.wide else "beside"),
        id=section.id,
        class_="figure",
    )
