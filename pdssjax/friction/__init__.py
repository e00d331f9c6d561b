"""Friction laws, one a file; a member's name in a study is its file's name.

Imports `core` and the series of `integration`.
"""
