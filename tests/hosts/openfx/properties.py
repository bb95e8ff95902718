# SPDX-License-Identifier: Apache-2.0
"""Properties of OpenFX that the plugin sets: type and dimension, 0 for any, from the specification of version 1.5."""

from __future__ import annotations

STRING, INT, DOUBLE, POINTER = "string", "int", "double", "pointer"
_EFFECT = {
    "OfxPropLabel": (STRING, 1),
    "OfxPropPluginDescription": (STRING, 1),
    "OfxImageEffectPluginPropGrouping": (STRING, 1),
    "OfxImageEffectPropSupportedContexts": (STRING, 0),
    "OfxImageEffectPropSupportedPixelDepths": (STRING, 0),
    "OfxImageEffectPluginPropSingleInstance": (INT, 1),
    "OfxImageEffectPluginPropHostFrameThreading": (INT, 1),
    "OfxImageEffectPropSupportsMultiResolution": (INT, 1),
    "OfxImageEffectPropSupportsTiles": (INT, 1),
    "OfxImageEffectPropTemporalClipAccess": (INT, 1),
    "OfxImageEffectPropClipPreferencesSlaveParam": (STRING, 0),
    "OfxImageEffectPluginRenderThreadSafety": (STRING, 1),
    "OfxImageEffectPropOpenCLRenderSupported": (STRING, 1),
    "OfxImageEffectPropColourManagementStyle": (STRING, 1),
    "OfxImageEffectPropColourManagementAvailableConfigs": (STRING, 0),
}
_CLIP = {
    "OfxPropLabel": (STRING, 1),
    "OfxImageClipPropOptional": (INT, 1),
    "OfxImageClipPropIsMask": (INT, 1),
    "OfxImageEffectPropTemporalClipAccess": (INT, 1),
    "OfxImageEffectPropSupportsTiles": (INT, 1),
    "OfxImageEffectPropSupportedComponents": (STRING, 0),
}
_PARAMETER = {
    "OfxPropLabel": (STRING, 1),
    "OfxParamPropHint": (STRING, 1),
    "OfxParamPropParent": (STRING, 1),
    "OfxParamPropAnimates": (INT, 1),
    "OfxParamPropEvaluateOnChange": (INT, 1),
    "OfxParamPropGroupOpen": (INT, 1),
    "OfxParamPropChoiceOption": (STRING, 0),
}
_RANGE = ("Default", "Min", "Max", "DisplayMin", "DisplayMax")
_OUT = {
    "OfxImageEffectPropRegionOfDefinition": (DOUBLE, 4),
    "OfxPropName": (STRING, 1),
    "OfxPropTime": (DOUBLE, 1),
    "OfxImageClipPropColourspace": (STRING, 1),
    "OfxImageEffectPropPreMultiplication": (STRING, 1),
}
_OF_CLIPS = {
    "OfxImageClipPropRoI_": (DOUBLE, 4),
    "OfxImageClipPropFrameRange_": (DOUBLE, 0),
    "OfxImageClipPropComponents_": (STRING, 1),
    "OfxImageClipPropDepth_": (STRING, 1),
}
TYPES = {  # of parameters: type and dimension of their values
    "OfxParamTypeInteger": (INT, 1),
    "OfxParamTypeDouble": (DOUBLE, 1),
    "OfxParamTypeBoolean": (INT, 1),
    "OfxParamTypeChoice": (INT, 1),
    "OfxParamTypeString": (STRING, 1),
    "OfxParamTypeInteger2D": (INT, 2),
    "OfxParamTypeGroup": (INT, 0),
    "OfxParamTypePushButton": (INT, 0),
}


def expected(kind: str, name: str) -> tuple[str, int] | None:
    """Type and dimension of a property in a set of that kind; None if such a set has none of that name."""
    if kind in TYPES:
        ranged = name.removeprefix("OfxParamProp") in _RANGE
        return TYPES[kind] if ranged and TYPES[kind][1] else _PARAMETER.get(name)
    if kind == "out":
        of_clip = next((facts for prefix, facts in _OF_CLIPS.items() if name.startswith(prefix)), None)
        return _OUT.get(name) or of_clip
    if kind == "options":  # of a choice of an instance
        return _PARAMETER[name] if name == "OfxParamPropChoiceOption" else None
    return {"effect": _EFFECT, "clip": _CLIP}.get(kind, {}).get(name)
