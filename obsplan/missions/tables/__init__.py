"""What `read_csv` is made of: rows, headings, cells, degrees and minutes, WKT."""
