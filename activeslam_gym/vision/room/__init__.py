"""A textured room, and our own ray-caster, which photographs it through the wide-angle lens."""
