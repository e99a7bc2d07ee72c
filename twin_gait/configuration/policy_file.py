"""Policies as YAML files: the section ``control.policy`` of an experiment."""

from functools import partial
from pathlib import Path
from typing import Any

from twin_gait.configuration.custom_sections import section_of
from twin_gait.configuration.gait_table_file import named_file, require_schema_version
from twin_gait.configuration.validation import convert_with_context, read_yaml, validate
from twin_gait.control.policy_parameters import PolicyParameters


def read_policy(name: str, path: Path, source: str = "") -> dict[str, Any]:
    """Return the section ``control.policy`` for the name of a shipped policy, or the path of its file.

    ``path``: file that contains the name, to whose folder a relative path refers; the working folder is
    searched next. ``source``: name of this file in messages. Raises ParameterFileError if there is no such
    policy, or if it has a mistake.
    """
    find = partial(named_file, name, "policies", path.parent)
    found = convert_with_context(source or str(path), "control.policy", find)
    data = read_yaml(found)
    require_schema_version(data, str(found))
    section = {key: data[key] for key in data if key != "schema_version"}
    section.setdefault("name", found.stem)
    checked = validate(section_of(PolicyParameters), section, str(found))
    convert_with_context(str(found), "", checked.convert)
    return section
