"""Hold what one probe run showed: what was asked, how its process ended, what the host knew, its files by content."""
