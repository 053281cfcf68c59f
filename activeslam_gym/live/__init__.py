"""The paper's live system: a page that tells a person with a camera, once a second, where to move.

A `source` gives images; a `session` feeds them to the front end and the filter, and asks an `advice` which motion would
teach the most; what is known after each image is a `state`, which a `page` shows and a `recording` keeps. The page is
served by a process of its own (`link`), for which tracking never waits.
"""
