# SPDX-License-Identifier: Apache-2.0
"""The library's report: a single HTML page with a sortable table of previews, measures and reasons, usable offline.

Previews are embedded. To keep the page small enough for browsers, it shows at most `_MOST` assets, those that are not
ok first.
"""

from __future__ import annotations

import base64
import contextlib
import html
import time
import urllib.parse
from pathlib import Path

from oiiotex.engine.errors import Error

from ..api.files import owned, temporary_beside
from .catalog import STATUSES, Asset, Catalog

FILE = "report.html"
_MOST = 1000
_COLUMNS = ("fidelity", "seam", "repeat", "loss", "regular", "normal_length", "height_steps", "convention")
_STYLE = """
body{font:14px/1.4 system-ui,sans-serif;margin:24px;color:#222;background:#fafafa}
h1{font-size:20px;margin:0 0 4px}p{margin:0 0 14px;color:#555}
table{border-collapse:collapse;background:#fff}
th,td{padding:6px 8px;overflow-wrap:break-word;border-bottom:1px solid #ddd;text-align:left}
.n{text-align:right}td.n{font-variant-numeric:tabular-nums}th{cursor:pointer;position:sticky;top:0;background:#eee}
th[data-way="1"]::after{content:" \\25B2"}th[data-way="-1"]::after{content:" \\25BC"}
img{max-height:120px;max-width:26vw;display:block;border-radius:3px}.ok{color:#16703a}.review,.asked{color:#a05a00}.failed{color:#b00020}
td.why{max-width:18em;overflow-wrap:anywhere}input{font:inherit;padding:4px 8px;margin-bottom:12px;width:24em}
div{overflow:auto;max-height:calc(100vh - 130px)}
@media(max-width:700px){
 body{margin:12px}input{width:100%;box-sizing:border-box}div{max-height:none}
 thead{font-size:12px}thead tr::before{content:"Sort by";padding:6px 8px}th.n{text-align:left}
 table,thead,tbody{display:block}tr{display:flex;flex-wrap:wrap}
 th{position:static}td{border:0;padding:2px 8px}td:first-child{flex:0 0 100%}td{box-sizing:border-box}
 tr+tr{border-top:1px solid #ddd}
 td.n[data-l]:not([data-v=""])::before{content:attr(data-l) " ";color:#555}td.why{max-width:none}img{max-width:100%}
}
"""
_SCRIPT = """
const body=document.querySelector('tbody'),heads=[...document.querySelectorAll('th')];
heads.forEach((head,n)=>head.addEventListener('click',()=>{
 const way=head.dataset.way==='1'?-1:1;heads.forEach(h=>delete h.dataset.way);head.dataset.way=way;
 const value=row=>row.cells[n].dataset.v??row.cells[n].textContent;
 const number=t=>t===''?NaN:Number(t);
 [...body.rows].sort((a,b)=>{const s=value(a),t=value(b),x=number(s),y=number(t);
  if(!isNaN(x)||!isNaN(y))return isNaN(x)?1:isNaN(y)?-1:way*(x-y);return way*s.localeCompare(t);
 }).forEach(row=>body.append(row));}));
document.querySelector('input').addEventListener('input',e=>{const t=e.target.value.toLowerCase();
 for(const row of body.rows)row.hidden=!row.textContent.toLowerCase().includes(t);});
"""


def write_report(catalog: Catalog, title: str) -> Path:
    """Write the report of a library, and return its path."""
    assets = sorted(catalog.assets().values(), key=lambda asset: (STATUSES.index(asset.status), asset.name))
    measures, sizes = catalog.measures(), catalog.sizes()
    named = {name for own in measures.values() for name in own}
    columns = [name for name in _COLUMNS if name in named]
    counts = {status: sum(asset.status == status for asset in assets) for status in reversed(STATUSES)}
    summary = ", ".join(f"{count} {status}" for status, count in counts.items() if count) or "no assets yet"
    if len(assets) > _MOST:
        summary += f"; showing {_MOST}, those that are not ok first"
    texts, numbers = ["photo, lit, repeated, compared", "name", "status", "reason", "size"], [*columns, "seconds", "MB"]
    heads = [f"<th>{head}</th>" for head in texts] + [f'<th class="n">{head}</th>' for head in numbers]
    rows = [
        _row(catalog.library, asset, measures.get(asset.name, {}), columns, sizes.get(asset.name, 0))
        for asset in assets[:_MOST]
    ]
    made = time.strftime("%Y-%m-%d %H:%M")
    page = (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f"<style>{_STYLE}</style><h1>{html.escape(title)}</h1><p>{made}: {summary}</p>"
        '<input aria-label="Filter by name, status or reason" placeholder="Filter by name, status or reason">'
        f"<div><table><thead><tr>{''.join(heads)}</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table></div><script>{_SCRIPT}</script></html>\n"
    )
    path = catalog.library / FILE
    with temporary_beside(path) as temporary:
        temporary.write_text(page)
    return path


def convention_text(correlation: float) -> str:
    """The measured convention of normals."""
    return f"{'OpenGL' if correlation > 0 else 'DirectX'} {abs(correlation):.2f}"


def _row(library: Path, asset: Asset, measures: dict[str, float], columns: list[str], size: int) -> str:
    name, why = html.escape(asset.name), html.escape("; ".join(asset.reasons))
    link = f'<a href="{urllib.parse.quote(asset.folder)}/">{name}</a>' if asset.folder else name
    viewer = f"{asset.folder}/{asset.name}.html"
    if asset.folder and (library / viewer).is_file():
        link += f' <a href="{urllib.parse.quote(viewer)}">plane</a>'
    pixels = f"{asset.width}×{asset.height}" if asset.width else ""
    numbers = [(column, measures.get(column), ".3g") for column in columns]
    numbers += [("seconds", asset.seconds or None, ".1f"), ("MB", size / 1e6 or None, ".1f")]
    cells = "".join(
        '<td class="n" data-v=""></td>'
        if value is None
        else f'<td class="n" data-l="{column}" data-v="{value:.6g}">'
        f"{convention_text(value) if column == 'convention' else format(value, form)}</td>"
        for column, value, form in numbers
    )
    return (
        f'<tr><td data-v="{name}">{_picture(library, asset)}</td><td>{link}</td>'
        f'<td class="{asset.status}">{asset.status}</td><td class="why">{why}</td>'
        f'<td data-v="{asset.width * asset.height}">{pixels}</td>{cells}</tr>'
    )


def _picture(library: Path, asset: Asset) -> str:
    with contextlib.suppress(OSError, Error):
        if asset.folder:
            picture = owned(library / asset.folder / "card.jpg", library)
            data = base64.b64encode(picture.read_bytes()).decode()
            return f'<img alt="{html.escape(asset.name)}" src="data:image/jpeg;base64,{data}">'
    return ""
