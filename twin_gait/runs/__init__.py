"""What a run leaves on the disk: its directory, its summary, and how it is read again.

What is offered here is imported when it is first asked for: pictures and tables take longer than a walk to
simulate.
"""
