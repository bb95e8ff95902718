# SPDX-License-Identifier: Apache-2.0
"""`python -m oiiotex.oiiotool.service.door`: starts the resident process for programs that are not written in Python.

Its argument is JSON: {"name": "wall.oiiotex?seed=7"}, or {"texture": TEXT} for a texture that was opened before, or
{"device": NAME} or {"device": null} for the process without a texture, whose color config "colorconfig" can name. When
the process listens, it prints {"socket": PATH, "texture": TEXT}; on failure, {"error": TEXT, "facts": FIELDS}.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from ...engine.errors import Error
from ...engine.session import Session
from .client import connect
from .settings import ResidentSettings
from .texture_file import TextureFile, read_texture_file


def answer(word: str) -> dict[str, Any]:
    """The answer to print."""
    try:
        asked = json.loads(word)
        if "device" in asked:
            settings = ResidentSettings.of(Session(device_name=asked["device"], colorconfig=asked.get("colorconfig")))
            connect(settings).close()
            return {"socket": str(settings.socket())}
        file = TextureFile.of_text(asked["texture"]) if "texture" in asked else read_texture_file(asked["name"])
        settings = file.settings()
        connect(settings).close()
    except Error as error:
        return {"error": str(error), "facts": error.facts()}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {"error": "malformed request"}
    return {"socket": str(settings.socket()), "texture": file.text()}


if __name__ == "__main__":
    print(json.dumps(answer(sys.argv[1])))
