"""The belief: an EKF over one camera and its map, from unlabelled pixels. Nothing here knows the truth."""
