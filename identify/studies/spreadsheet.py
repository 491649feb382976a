"""Excel workbooks (Office Open XML) written plainly: numbers as numbers, text as inline text and never as a formula."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Sequence
from xml.sax.saxutils import escape

from identify.studies.clean import cell
from identify.studies.sheets import Sheet

MOST_ROWS, MOST_COLUMNS = 1_048_576, 16_384
STAMP = (1980, 1, 1, 0, 0, 0)  # the same tables give the same bytes
_BAD = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_RELATIONS = "http://schemas.openxmlformats.org/package/2006/relationships"
_DOCUMENT = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_HEAD = '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>\n'
STYLES = (
    f'{_HEAD}<styleSheet xmlns="{_MAIN}"><fonts count="2"><font><sz val="11"/><name val="Calibri"/></font>'
    '<font><b/><sz val="11"/><name val="Calibri"/></font></fonts><fills count="1"><fill><patternFill '
    'patternType="none"/></fill></fills><borders count="1"><border/></borders><cellStyleXfs count="1"><xf/>'
    '</cellStyleXfs><cellXfs count="2"><xf/><xf fontId="1" applyFont="1"/></cellXfs>'
    '<cellStyles count="1"><cellStyle name="Normal" xfId="0" builtinId="0"/></cellStyles></styleSheet>'
)


def workbook(sheets: Sequence[Sheet]) -> bytes:
    """The bytes of an .xlsx file with one sheet per table; the first row of each is its head and stays in sight."""
    names = _names(sheets)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, text in _frame(names).items():
            archive.writestr(zipfile.ZipInfo(path, STAMP), text, zipfile.ZIP_DEFLATED)
        for number, sheet in enumerate(sheets, 1):
            info = zipfile.ZipInfo(f"xl/worksheets/sheet{number}.xml", STAMP)
            archive.writestr(info, _sheet(sheet), zipfile.ZIP_DEFLATED)
    return out.getvalue()


def _names(sheets: Sequence[Sheet]) -> list[str]:
    names: list[str] = []
    for sheet in sheets:
        plain = re.sub(r"[\[\]:*?/\\']", " ", sheet.name)[:28].strip() or "table"
        names.append(plain if plain not in names else f"{plain} {len(names)}")
    return names


def _frame(names: Sequence[str]) -> dict[str, str]:
    """All parts of the archive but the sheets."""
    numbers = range(1, len(names) + 1)
    types = "".join(
        f'<Override PartName="/xl/worksheets/sheet{n}.xml" ContentType="application/vnd.openxmlformats-officedocument.'
        'spreadsheetml.worksheet+xml"/>'
        for n in numbers
    )
    base = "application/vnd.openxmlformats-officedocument.spreadsheetml"
    listed = "".join(
        f'<sheet name="{escape(name)}" sheetId="{n}" r:id="rId{n}"/>' for n, name in zip(numbers, names, strict=True)
    )
    links = "".join(
        f'<Relationship Id="rId{n}" Type="{_DOCUMENT}/worksheet" Target="worksheets/sheet{n}.xml"/>' for n in numbers
    )
    return {
        "[Content_Types].xml": (
            f'{_HEAD}<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types"><Default '
            'Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default '
            f'Extension="xml" ContentType="application/xml"/><Override PartName="/xl/workbook.xml" ContentType="{base}'
            f'.sheet.main+xml"/><Override PartName="/xl/styles.xml" ContentType="{base}.styles+xml"/>{types}</Types>'
        ),
        "_rels/.rels": (
            f'{_HEAD}<Relationships xmlns="{_RELATIONS}"><Relationship Id="rId1" Type="{_DOCUMENT}/officeDocument" '
            'Target="xl/workbook.xml"/></Relationships>'
        ),
        "xl/workbook.xml": (
            f'{_HEAD}<workbook xmlns="{_MAIN}" xmlns:r="{_DOCUMENT}"><sheets>{listed}</sheets></workbook>'
        ),
        "xl/_rels/workbook.xml.rels": (
            f'{_HEAD}<Relationships xmlns="{_RELATIONS}">{links}<Relationship Id="rId{len(names) + 1}" '
            f'Type="{_DOCUMENT}/styles" Target="styles.xml"/></Relationships>'
        ),
        "xl/styles.xml": STYLES,
    }


def _sheet(sheet: Sheet) -> str:
    rows = [(sheet.heads, 1), *((row, 0) for row in sheet.rows[: MOST_ROWS - 1])]
    body = "".join(
        f'<row r="{r}">' + "".join(_cell(value, r, c, style) for c, value in enumerate(row[:MOST_COLUMNS])) + "</row>"
        for r, (row, style) in enumerate(rows, 1)
    )
    pane = (
        '<sheetViews><sheetView workbookViewId="0"><pane ySplit="1" topLeftCell="A2" state="frozen"/></sheetView>'
        '</sheetViews><sheetFormatPr defaultRowHeight="15"/><cols><col min="1" max="3" width="20" customWidth="1"/>'
        "</cols>"
    )
    return f'{_HEAD}<worksheet xmlns="{_MAIN}">{pane}<sheetData>{body}</sheetData></worksheet>'


def _cell(value: object, row: int, column: int, style: int) -> str:
    content = cell(value)
    place = f'r="{_letters(column)}{row}"' + (f' s="{style}"' if style else "")
    if content is None:
        return ""
    if isinstance(content, str):
        text = escape(_BAD.sub("\N{REPLACEMENT CHARACTER}", content))
        return f'<c {place} t="inlineStr"><is><t xml:space="preserve">{text}</t></is></c>'
    return f"<c {place}><v>{content!r}</v></c>"


def _letters(column: int) -> str:
    """0 -> "A", 26 -> "AA"."""
    letters = ""
    column += 1
    while column:
        column, rest = divmod(column - 1, 26)
        letters = chr(65 + rest) + letters
    return letters
