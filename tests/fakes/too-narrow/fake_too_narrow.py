WORD = "too narrow by its metadata"
