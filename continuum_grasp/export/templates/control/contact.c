static void write_felt(const <<p>>_contact_report *from, <<p>>_contact *to)
{
  to->verdict = (<<p>>_real)from->verdict;
  memcpy(to->residual, from->residual, sizeof to->residual);
  memcpy(to->low, from->low, sizeof to->low);
  memcpy(to->high, from->high, sizeof to->high);
  memcpy(to->gain, from->gain, sizeof to->gain);
  memcpy(to->threshold, from->threshold, sizeof to->threshold);
  memcpy(to->force_low, from->force_low, sizeof to->force_low);
  memcpy(to->force_high, from->force_high, sizeof to->force_high);
}
