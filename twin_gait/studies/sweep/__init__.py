"""Resumable sweeps over any parameters of an experiment."""
