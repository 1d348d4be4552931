def requires(stage):
    return ["fake-plain>=2"] if stage == "wheel" else []
