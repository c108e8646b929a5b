"""The lesson's claims against what was measured here: ``docs/claims.md``, written from committed result files."""
