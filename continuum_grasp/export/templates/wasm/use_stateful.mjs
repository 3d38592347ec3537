const <<owner>> = finger.new_<<owner>>();
const <<output>> = <<owner>>.step();
if (<<output>>.code < 0) ++failed;
console.log(JSON.stringify(<<output>>));
