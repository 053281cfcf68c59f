"""The top floor: the study that compares policies (`python -m agents compare`), and the policies that learn."""
