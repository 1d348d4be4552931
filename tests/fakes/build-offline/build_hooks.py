from urllib.request import urlopen


def files(found):
    urlopen("http://vendor.invalid/archive.zip")
