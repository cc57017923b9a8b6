#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Checks a JSON document against a JSON schema: exit code 0 where it follows it, 1 and the first
fault where it does not, 77 where jsonschema is missing.

    check_schema.py SCHEMA DOCUMENT
"""

import json
import sys

try:
    import jsonschema
except ImportError:
    sys.exit(77)

with open(sys.argv[1]) as file:
    schema = json.load(file)
with open(sys.argv[2]) as file:
    document = json.load(file)
jsonschema.Draft7Validator.check_schema(schema)
for fault in jsonschema.Draft7Validator(schema).iter_errors(document):
    print("/".join(map(str, fault.absolute_path)), fault.message[:200])
    sys.exit(1)
