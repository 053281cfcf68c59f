"""The paper's live system: a page that advises a person with a camera, once a second, where to move.

A `source` gives images. A `session` feeds them to the front end and the filter, and asks an `advice` for the most
informative motion. It gives a `state` after each image, which a `page` shows and a `recording` keeps.
"""
