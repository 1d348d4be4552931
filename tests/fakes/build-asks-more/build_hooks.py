def more_requirements():
    return ["fake-build-tool<2"]


def files(found):
    import fake_build_tool

    return {path: text.replace("@TOOL@", fake_build_tool.VERSION) for path, text in found.items()}
