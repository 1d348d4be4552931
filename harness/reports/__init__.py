"""Make documents of assessed cells, and all that is shown of them: tables, texts, answers, packs of evidence."""
