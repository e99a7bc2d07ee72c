"""YAML in and out: gait tables, experiments and people, validated at the edge."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
