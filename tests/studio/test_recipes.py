# SPDX-License-Identifier: Apache-2.0
"""What is found in a folder by names, and the lines that a recipe has for it."""

from __future__ import annotations

import os
import re
import zipfile

import pytest
from oiiotex_studio.materials.naming import read_name
from oiiotex_studio.recipes import found as finding
from oiiotex_studio.recipes.found import MapFile, materials
from oiiotex_studio.recipes.lines import require_lines, steps_of
from oiiotex_studio.recipes.recipe import commented_recipe, load_recipe

from oiiotex.engine import errors
from tests.library_makings import LINE, names_of, recipe, touched
from tests.library_makings import photos as photos


@pytest.mark.parametrize(
    ("stem", "read"),
    [
        ("aerial_rocks_02_nor_gl_2k", ("aerial_rocks_02", "normal", "opengl", ("2k",))),
        ("aerial_rocks_02_diff_4k", ("aerial_rocks_02", "color", "", ("4k",))),
        ("Rock053_2K-JPG_NormalDX", ("Rock053", "normal", "directx", ("jpg", "2k"))),
        ("Rock053_1K_Color", ("Rock053", "color", "", ("1k",))),
        ("Rock053_1K-PNG_AmbientOcclusion", ("Rock053", "ao", "", ("png", "1k"))),
        ("tlzxbbr_2K_Albedo", ("tlzxbbr", "color", "", ("2k",))),
        ("Stone_Wall_Base_Color", ("Stone_Wall", "color", "", ())),
        ("lambert1_Normal_OpenGL", ("lambert1", "normal", "opengl", ())),
        ("metal_plate_metal_1k", ("metal_plate", "metal", "", ("1k",))),
        ("rusty_metal_albedo", ("rusty_metal", "color", "", ())),
        ("forest_arm_2k", ("forest", "arm", "", ("2k",))),
        ("rock_disp_1024x1024", ("rock", "height", "", ("1024x1024",))),
        ("roughness", ("", "roughness", "", ())),
        ("IMG_2041", ("IMG_2041", "", "", ())),
        ("opengl", ("opengl", "", "", ())),
        ("beach_4k", ("beach", "", "", ("4k",))),
    ],
)
def test_names_are_read_as_people_write_them(stem, read):
    assert read_name(stem) == read


def test_further_words_of_a_recipe_say_a_role():
    assert read_name("wall_kd", {"color": ("kd",)}).role == "color"


def test_maps_are_gathered_by_folder_and_name_also_out_of_archives(tmp_path):
    touched(tmp_path, "a/moss_diff_1k.jpg", "a/moss_nor_gl_1k.exr", "a/moss_nor_dx_1k.exr", "b/moss_diff_1k.jpg")
    touched(tmp_path, "clay/albedo.png", "clay/rough.png", ".hidden/y.png", "photo 1.jpg")
    with zipfile.ZipFile(tmp_path / "Rock053_1K.zip", "w") as archive:
        archive.writestr("Rock053_1K_Color.jpg", b"")
        archive.writestr("Rock053_1K_NormalGL.jpg", b"")
        archive.writestr("preview.txt", b"")
    found = names_of(tmp_path, recipe())
    assert sorted(found) == ["Rock053", "a_moss", "b_moss", "clay", "photo_1"]
    assert found["a_moss"] == ({"color": "a/moss_diff_1k.jpg", "normal": "a/moss_nor_gl_1k.exr"}, ())
    assert found["Rock053"][0]["normal"] == "Rock053_1K.zip!Rock053_1K_NormalGL.jpg"
    assert found["clay"] == ({"color": "clay/albedo.png", "roughness": "clay/rough.png"}, ())


def test_what_is_ambiguous_is_asked_for_and_the_recipe_answers(tmp_path):
    touched(tmp_path, "m_col_1k.png", "m_col_2k.png", "m_normal.png", "m_thing.png", "o_rough.png")
    found = names_of(tmp_path, recipe())
    assert [question.split(":")[0] for question in found["m"][1]] == ["which file is the color"]
    assert "which file is the color?" in found["o"][1][0]
    answered = '[find]\nprefer = ["2k"]\nskip = false\n[assets.o]\nskip = true\n[assets.m]\nnormals = "directx"\n'
    found = materials(tmp_path, recipe(answered + LINE))
    by_name = {material.name: material for material in found}
    assert "o" not in by_name and by_name["m"].questions == ()
    assert by_name["m"].maps["color"].path == "m_col_2k.png"
    assert by_name["m"].maps["normal"].hand == "directx"
    assert by_name["m_thing"].maps["color"].path == "m_thing.png"


def test_a_nameless_file_beside_maps_is_asked_for(tmp_path):
    touched(tmp_path, "rock/rock.png", "rock/rock_rough.png")
    (question,) = names_of(tmp_path, recipe())["rock"][1]
    assert question.startswith("which role has rock/rock.png?")
    told = recipe('[assets.rock]\nmaps = { color = "rock/rock.png" }\n' + LINE)
    assert names_of(tmp_path, told)["rock"] == ({"color": "rock/rock.png", "roughness": "rock/rock_rough.png"}, ())


def test_packed_maps_are_channels(tmp_path):
    touched(tmp_path, "f_diff.png", "f_arm.png", "f_rough.png")
    (material,) = materials(tmp_path, recipe())
    assert material.maps["ao"] == MapFile("f_arm.png", channel="R")
    assert material.maps["metal"].channel == "B"
    assert material.maps["roughness"] == MapFile("f_rough.png")
    (step,) = steps_of(recipe(), material.maps)
    assert "source/ao.png --iscolorspace data --ch R" in " ".join(step.words)


def test_what_is_known_lies_beside_the_photo_or_in_the_recipe(tmp_path):
    touched(tmp_path, "moss_diff.png")
    (tmp_path / "moss.toml").write_text('license = "CC-BY-4.0"\ntags = ["green"]\nsize_m = [2, 2]\n')
    told = recipe('[find]\nauthor = "we"\ntags = ["scan"]\n[assets.moss]\nauthor = "she"\n' + LINE)
    (material,) = materials(tmp_path, told)
    facts = material.facts
    assert (facts.license, facts.author, facts.tags, facts.size_m) == ("CC-BY-4.0", "she", ("scan", "green"), (2, 2))


def test_what_cannot_be_read_is_asked_for_and_a_library_is_no_photo(tmp_path):
    touched(tmp_path, "a.png", "b.png", "lib/library.sqlite", "lib/assets/x/k/thumbnail.jpg", "other.toml")
    (tmp_path / "bad.zip").write_bytes(b"no archive")
    with zipfile.ZipFile(tmp_path / "name.zip", "w") as archive:
        archive.writestr("\u00e9.png", b"")
    (tmp_path / "name.zip").write_bytes((tmp_path / "name.zip").read_bytes().replace(b"\xc3\xa9", b"\xff\xff"))
    (tmp_path / "b.toml").write_text("license = 3\n")
    found = {material.name: material for material in materials(tmp_path, recipe())}
    assert sorted(found) == ["a", "b", "bad", "name"] and found["a"].questions == ()
    assert "name.zip: 'utf-8' codec" in found["name"].questions[0]
    assert "bad.zip" in found["bad"].questions[0] and "license: expected a string" in found["b"].questions[0]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="NOT RUN: no pipes with names")
def test_a_pipe_is_no_photo(tmp_path):
    touched(tmp_path, "a.png")
    for name in ("a.toml", "b.png", "c.zip"):
        os.mkfifo(tmp_path / name)
    assert list(names_of(tmp_path, recipe())) == ["a"]


def test_an_archive_of_zeros_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(finding, "_LARGE", 1 << 18)
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("bomb.png", bytes(1 << 20))
        archive.writestr("small.png", bytes(1 << 17))
        archive.writestr("photo.png", os.urandom(1 << 10) * (1 << 9))  # 512 KB, and packed by far less than zeros
    with pytest.raises(errors.Error, match=r"a\.zip!bomb\.png: unpacks to over 200 times its size"):
        finding.extract(tmp_path, MapFile("a.zip", "bomb.png"), tmp_path / "bomb.png")
    assert not (tmp_path / "bomb.png").exists()
    for name in ("small.png", "photo.png"):
        finding.extract(tmp_path, MapFile("a.zip", name), tmp_path / name)
        assert (tmp_path / name).stat().st_size >= 1 << 17


def test_the_printed_recipe_holds_also_with_all_its_offers_taken(tmp_path):
    path = tmp_path / "recipe.toml"
    path.write_text(commented_recipe())
    plain = load_recipe(path)
    assert require_lines(plain) == "tile"
    offers = re.sub(r"(?m)^# (?=\[|[a-z_]+ = )", "", commented_recipe())
    path.write_text(offers)
    full = load_recipe(path)
    assert [product.name for product in full.products] == ["tile", "labels", "palette", "dominant"]
    require_lines(full)
    assert (plain.deliver, plain.find.photos) == (full.deliver, full.find.photos)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[[product]]\nname = "t"\nline = "$maps --texnothing $outputs"\n', "unknown option '--texnothing'"),
        ('[[product]]\nname = "t"\nline = "$maps --texflatten:sgma=2 $outputs"\n', "sgma"),
        ('[[product]]\nname = "t"\nline = "$color -o $output"\n', "0 products have [$]outputs"),
        ('[[product]]\nname = "t"\nline = "$map $outputs"\n', "unknown placeholder [$]map"),
        ('[[product]]\nname = "t"\nline = "x$color $outputs"\n', "[$]color must be a separate word"),
        ('[[product]]\nname = "t"\nline = "$maps \\"$outputs"\n', "No closing quotation"),
        (
            '[[product]]\nname = "t"\nline = "$maps --texlive $outputs"\n',
            "t: --texlive cannot be used in a",
        ),
        ('[[product]]\nname = "t"\nline = "$maps $outputs --tev"\n', "--tev cannot be used in a recipe"),
        (
            '[[product]]\nname = "t"\nline = "$maps --farm dask=local:2 $outputs"\n',
            "--farm cannot be used .*ingest. distributes",
        ),
        (
            '[[product]]\nname = "t"\nline = "$maps --share 1/2 $outputs"\n',
            "--share cannot be used .*ingest. distributes",
        ),
        ('[[product]]\nname = "t"\nline = "$maps $outputs --join"\n', "--join cannot be used .*ingest. distributes"),
        ('[[product]]\nname = "t"\nline = "$maps $outputs $outputs"\n', "[$]outputs occurs twice"),
        ('[[product]]\nname = "t"\nline = "$maps $outputs x.png"\n', "'x.png' after [$]outputs: expected only options"),
        ('[[product]]\nname = "t"\nline = "$maps -o $outputs"\n', "t: -o would take the first word of [$]outputs"),
        ('[[product]]\nname = "t"\nline = "$maps -o $color $outputs"\n', "-o would take the first word of [$]color"),
        ('[[product]]\nname = "t"\nline = "$maps -o x.exr $outputs"\n', "-o x.exr: is not in the product's folder"),
        ('[[product]]\nname = "t"\nline = "$maps -otex t/../x.tx $outputs"\n', "-otex t/../x.tx: is not in the"),
        ('[[product]]\nname = "t"\nline = "$maps -o /x/{NIMAGES}.exr $outputs"\n', "-o /x/.*: is not in the product"),
        (
            '[[product]]\nname = "t"\nline = "$maps --texstationarize:report=/tmp/x.json $outputs"\n',
            "--texstationarize:report=/tmp/x.json: is not in the product's folder",
        ),
        (
            '[[product]]\nname = "t"\nline = "$maps --texstationarize:st=../x.exr $outputs"\n',
            "--texstationarize:st=../x.exr: is not in the product's folder",
        ),
        ('[[product]]\nname = "T"\nline = "$maps $outputs"\n', "name 'T': expected a-z"),
        ('[[product]]\nname = "t"\n', r"product\[0\]: line is missing: expected a string"),
        ("", "no .*product.*: expected at least one"),
        (LINE + "[deliver]\nformat = 'png'\n", "deliver.format: expected 'exr' or 'tiff', not 'png'"),
        (LINE + "[deliver]\ntx = 1\n", "deliver.tx: expected true or false, not 1"),
        (LINE + "[delivr]\ntx = true\n", "unknown key 'delivr'.*deliver"),
        (LINE + "[judge]\nlimits = ['seam']\n", "judge: limits=seam: expected NAME>NUMBER"),
        (LINE + "[roles.colr]\nspace = 'data'\n", "roles 'colr': expected color"),
        ('[[product]]\nname = "t"\nline = "$maps a\\u0000b $outputs"\n', "t: a line cannot contain the character NUL"),
        (LINE + "[assets.x]\nsize_m = [1]\n", "expected width and height in meters"),
    ],
)
def test_what_a_recipe_says_wrong_is_one_line(text, says):
    with pytest.raises(errors.Error, match=says):
        require_lines(recipe(text))


def test_a_number_of_too_many_digits_is_one_line(tmp_path):
    path = tmp_path / "recipe.toml"
    path.write_text(f"a = {'1' * 5000}\n")
    with pytest.raises(errors.Error, match=r"recipe\.toml: Exceeds the limit"):
        load_recipe(path)


def test_lines_get_files_kinds_and_folders(photos):
    told = recipe(
        '[[product]]\nname = "tile"\nline = "$maps --texstationarize:kinds=$kinds:report=$report $outputs"\n'
        '[[product]]\nname = "again"\nline = "$tile.color --flip -o $folder/$$x.png"\n'
        '[[product]]\nname = "high"\nline = "$height -o $output"\n'
        '[[product]]\nname = "higher"\nline = "$high.high -o $output"\n'
    )
    (wall,) = [m for m in materials(photos, told) if m.name == "wall"]
    steps = steps_of(told, wall.maps)
    assert [step.product for step in steps] == ["tile", "again"]  # it has no heights
    assert " ".join(steps[0].words) == (
        "source/color.png --iscolorspace srgb_rec709_scene source/normal.png --iscolorspace data"
        " source/roughness.png --iscolorspace data"
        " --texstationarize:kinds=color,normal,data:report=tile/report.json"
        " -d half -o tile/roughness.exr --pop -d half -o tile/normal.exr --pop"
        " --tocolorspace lin_rec709_scene -d half -o tile/color.exr"
    )
    assert steps[1].words == ("tile/color.exr", "--flip", "-o", "again/$x.png")
    assert steps[1].takes == ("tile",)


def test_the_library_makes_powers_of_two_by_default():
    line = next(line for line in commented_recipe().splitlines() if line.startswith("line = ") and "$maps" in line)
    assert ":size=pow2:" in line
