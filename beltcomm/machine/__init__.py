"""One axis behind one drive: limits, watches row by row, what is put back."""
