"""Matplotlib's SVG made fit to stand inside an HTML page: small, self-contained, ids of its own."""

from __future__ import annotations

import re

FONTS = "system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif"
_TAG = re.compile(r"<[^>]*>")
_LONG_NUMBER = re.compile(r"(-?\d+\.\d\d)\d+")
_FONT = re.compile(r"'DejaVu Sans'(?:, *sans-serif)?")


def inline_svg(text: str, prefix: str) -> str:
    """The <svg> element of an SVG file for use inside HTML.

    Prolog, metadata and name-space addresses go (HTML implies them); `prefix` keeps the ids of several
    figures in one page apart; coordinates are cut to a hundredth of a point; width and height become
    the page's business. Texts stay as they are. ValueError where there is no viewBox.
    """
    body = text[text.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r"<!--.*?-->", "", body, flags=re.DOTALL)
    head, rest = body.split(">", 1)
    box = re.search(r'viewBox="([^"]*)"', head)
    if box is None:
        raise ValueError("this SVG has no viewBox, so it cannot be scaled to the page")

    def tidy(tag: re.Match[str]) -> str:
        kept = re.sub(r'\bid="', f'id="{prefix}-', tag[0])
        kept = kept.replace('href="#', f'href="#{prefix}-').replace("url(#", f"url(#{prefix}-")
        kept = _FONT.sub(FONTS, _LONG_NUMBER.sub(r"\1", kept))
        return re.sub(r"\s*\n\s*", " ", kept)

    rest = re.sub(r">\s*\n\s*<", ">\n<", _TAG.sub(tidy, rest))
    return f'<svg viewBox="{box.group(1)}" aria-hidden="true" focusable="false">{rest.rstrip()}'
