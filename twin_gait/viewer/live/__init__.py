"""The live page: a web server for this machine only, and the panel with its controls.

Nothing here knows the simulation. The server carries what it is given to any number of pages and hands on
what they say; :mod:`twin_gait.live` decides what it means.
"""
