"""Fault campaigns, and what must hold in every run of one."""
