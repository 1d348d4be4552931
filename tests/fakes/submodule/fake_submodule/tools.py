raise RuntimeError("a module that registers nothing is not imported")
