"""Group the cells of a document into tables: plain data, ready to be shown in any form."""

__all__ = ["cause_groups", "change_effects", "family_tables", "table_types", "tables"]
