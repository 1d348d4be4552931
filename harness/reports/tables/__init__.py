"""Group the cells of a document into tables: plain data, ready to be shown in any form."""
