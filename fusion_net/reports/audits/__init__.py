"""The audits of a run: their pictures, their page, and the order in which they are made."""
