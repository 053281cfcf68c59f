"""Draws a snapshot: the map with its uncertainty, the camera's image, the entropy so far.

`scene` says what is shown, where it lies on the page, and in which colours, and needs no drawing library. `picture`
draws it by matplotlib, in an array or on a screen, and is imported when something is drawn.
"""
