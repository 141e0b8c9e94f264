"""As much of JSON Schema, draft 2020-12, as the schema of campaigns is written in; any other keyword is an error."""

import json
import re

SAYS_NOTHING = {"$schema", "$defs", "title", "description"}
TYPES = {
    "object": lambda value: isinstance(value, dict),
    "array": lambda value: isinstance(value, list),
    "string": lambda value: isinstance(value, str),
    "null": lambda value: value is None,
    "number": lambda value: isinstance(value, int | float) and not isinstance(value, bool),
}
SIMPLE = {
    "type": lambda value, kind: TYPES[kind](value),
    "const": lambda value, wanted: json.dumps(value) == json.dumps(wanted),
    "enum": lambda value, wanted: json.dumps(value) in [json.dumps(each) for each in wanted],
    "minimum": lambda value, limit: not TYPES["number"](value) or value >= limit,
    "maximum": lambda value, limit: not TYPES["number"](value) or value <= limit,
    "exclusiveMinimum": lambda value, limit: not TYPES["number"](value) or value > limit,
    "minLength": lambda value, limit: not isinstance(value, str) or len(value) >= limit,
    "maxLength": lambda value, limit: not isinstance(value, str) or len(value) <= limit,
    "pattern": lambda value, pattern: not isinstance(value, str) or re.search(pattern, value) is not None,
    "minItems": lambda value, limit: not isinstance(value, list) or len(value) >= limit,
    "maxItems": lambda value, limit: not isinstance(value, list) or len(value) <= limit,
    "minProperties": lambda value, limit: not isinstance(value, dict) or len(value) >= limit,
    "required": lambda value, names: not isinstance(value, dict) or all(name in value for name in names),
}


def conforms(value, schema, root=None):
    """Whether a JSON value conforms to a schema."""
    root = schema if root is None else root

    def nested(part, inner):
        return conforms(part, inner, root)

    for keyword, said in schema.items():
        if keyword in SAYS_NOTHING or keyword in ("then", "else"):
            continue
        if keyword in SIMPLE:
            good = SIMPLE[keyword](value, said)
        elif keyword == "$ref":
            good = nested(value, root["$defs"][said.removeprefix("#/$defs/")])
        elif keyword == "anyOf":
            good = any(nested(value, each) for each in said)
        elif keyword == "if":
            good = nested(value, schema["then"] if nested(value, said) else schema["else"])
        elif keyword == "items":
            good = not isinstance(value, list) or all(nested(each, said) for each in value)
        elif keyword == "properties":
            good = not isinstance(value, dict) or all(nested(value[name], said[name]) for name in said if name in value)
        elif keyword == "additionalProperties" and said is False:
            good = not isinstance(value, dict) or set(value) <= set(schema["properties"])
        else:
            raise NotImplementedError(keyword)
        if not good:
            return False
    return True
