"""Simulation of the joint bench: one motor, its gear and a link with a weight.

A test is one record (:mod:`.episode`). The steps of its loop (:mod:`.tick`, :mod:`.mechanics`) are ordinary
functions of this record, which :mod:`.loop` builds and passes to the compiled loop.
"""
