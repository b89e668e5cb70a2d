"""Pages in the browser of this computer: files of this package, and answers to what they ask; nothing from outside, nothing of a folder."""
