"""Compare what several cells made of the same states: classes, families, boundaries. Pure functions over arrays."""

__all__ = ["comparison", "consequence", "families", "outputs", "pixel_sentences", "pixels", "relation", "sentences"]
