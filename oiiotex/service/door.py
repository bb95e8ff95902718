# SPDX-License-Identifier: Apache-2.0
"""`python -m oiiotex.service.door`: what a program that is no Python asks for the resident process of a texture.

Its one word is JSON, {"name": "wall.oiiotex?seed=7"} or {"texture": TEXT} for one that was opened before. It prints
{"socket": PATH, "texture": TEXT}, once that process listens, or {"error": TEXT}.
"""

from __future__ import annotations

import json
import sys

from ..errors import Error
from .client import connect
from .texture_file import TextureFile, read_texture_file


def answer(word: str) -> dict[str, str]:
    """What is printed.

    Parameters
    ----------
    word : str
        As above.
    """
    try:
        asked = json.loads(word)
        file = TextureFile.of_text(asked["texture"]) if "texture" in asked else read_texture_file(asked["name"])
        settings = file.settings()
        connect(settings).close()
    except Error as error:
        return {"error": str(error)}
    return {"socket": str(settings.socket()), "texture": file.text()}


if __name__ == "__main__":
    print(json.dumps(answer(sys.argv[1])))
