"""Pages in the browser, by viser: fields, clouds and photographs that follow the mouse.

A page (`server`) collects what changed, and one thread, which owns the kernels, makes the pictures.
"""
