"""When stations send: the rules of ETSI's services, one a file, as pure logic over ticks and states."""
