"""Whatever a DXF, IFC or GeoJSON drawing holds, reading and checking it gives a plan or a SlamgymError."""

import drawn_flat as flat
from fuzz.mutations import cases, must_read_or_refuse, mutated_json, mutated_text
from hypothesis import given

from slamgym.cad import check_plan, open_plans


def check_drawing(path):
    source = open_plans(path)
    for plan_id in source.ids:
        check_plan(source.load(plan_id))


DXF = [flat.dxf().encode(), flat.dxf(unit="mm", swings=True, block=True).encode()]
# The first kilobytes of a DXF are tables that no plan comes from.
ENTITIES = [text[text.index(b"BLOCKS") - 200 :] for text in DXF]


@given(mutated_json([flat.geojson()]))
@cases(150)
def test_geojson(tmp_path, content):
    path = tmp_path / "a.geojson"
    path.write_bytes(content)
    must_read_or_refuse(check_drawing, path)


@given(mutated_text(DXF))
@cases(25)
def test_dxf(tmp_path, content):
    path = tmp_path / "a.dxf"
    path.write_bytes(content)
    must_read_or_refuse(check_drawing, path)


@given(mutated_text(ENTITIES))
@cases(25)
def test_entities_of_dxf(tmp_path, content):
    path = tmp_path / "a.dxf"
    path.write_bytes(DXF[0][: DXF[0].index(b"BLOCKS") - 200] + content)
    must_read_or_refuse(check_drawing, path)


@given(mutated_text([flat.ifc().encode()]))
@cases(40)
def test_ifc(tmp_path, monkeypatch, content):
    monkeypatch.setenv("SLAMGYM_MAX_READER_SECONDS", "10")
    path = tmp_path / "a.ifc"
    path.write_bytes(content)
    must_read_or_refuse(check_drawing, path)
