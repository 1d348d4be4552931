"""A stand-in for NVIDIA's Isaac Gym: see the README two folders above."""
