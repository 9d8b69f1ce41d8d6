// The search fetches each page that it found to show a part of it. A browser refuses this to pages that are opened from disk.
DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY &&= location.protocol !== "file:";
