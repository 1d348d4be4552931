raise RuntimeError("this setup knows no such Python")
