"""YAML in and out: gait tables, experiments and people, validated at the edge."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# A module of the same name would be found in its place.
from twin_gait.configuration.people import people as people  # noqa: E402
